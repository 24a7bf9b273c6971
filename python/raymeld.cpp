// The library for Python: NumPy arrays of (height, width, channels) in and out.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <map>
#include <mutex>
#include <raymeld/raymeld.hpp>

namespace py = pybind11;

namespace {

using Array = py::array_t<float, py::array::forcecast>;

std::string text_of(const std::vector<py::ssize_t>& shape) { return py::str(py::tuple(py::cast(shape))); }

// (height, width, 3), as planes at `planes`. Throws ValueError.
void copy_planes(const Array& image, const std::string& name, size_t height, size_t width, float* planes) {
  const std::vector<py::ssize_t> shape(image.shape(), image.shape() + image.ndim()),
      expected{py::ssize_t(height), py::ssize_t(width), 3};
  if (shape != expected)
    throw py::value_error(name + " has the shape " + text_of(shape) + ", expected " + text_of(expected));
  const auto pixels = image.unchecked<3>();
  for (py::ssize_t c = 0; c < 3; ++c)
    for (py::ssize_t y = 0; y < expected[0]; ++y)
      for (py::ssize_t x = 0; x < expected[1]; ++x) *planes++ = pixels(y, x, c);
}

template <typename Value>
Value one_of(const std::string& text, const char* name,
             const std::vector<std::pair<std::string, Value>>& choices) {
  std::string expected;
  for (const auto& [choice, value] : choices) {
    if (text == choice) return value;
    expected += (expected.empty() ? "" : ", ") + choice;
  }
  throw py::value_error(std::string(name) + " is '" + text + "', expected one of " + expected);
}

// Of one size, as the arguments of Fusion() say.
class Fuser {
 public:
  Fuser(std::shared_ptr<raymeld::SharedModel> model, uint32_t height, uint32_t width,
        const std::string& precision, const std::string& kernels, const std::string& sampling,
        uint64_t max_memory_bytes, float exposure, float adaptive_threshold, bool changed_only,
        const std::vector<std::string>& absent_layers, const std::string& device)
      : height_(height), width_(width) {
    raymeld_fusion_desc desc;
    desc.height = height;
    desc.width = width;
    desc.precision = one_of<raymeld_precision>(precision, "precision",
                                               {{"auto", RAYMELD_PRECISION_AUTO},
                                                {"fp32", RAYMELD_PRECISION_FP32},
                                                {"fp16", RAYMELD_PRECISION_FP16}});
    desc.kernels = one_of<raymeld_kernels>(
        kernels, "kernels", {{"auto", RAYMELD_KERNELS_AUTO}, {"direct", RAYMELD_KERNELS_DIRECT}});
    desc.lrhs_sampling = one_of<raymeld_sampling>(sampling, "sampling",
                                                  {{"model", RAYMELD_SAMPLING_MODEL},
                                                   {"nearest", RAYMELD_SAMPLING_NEAREST},
                                                   {"centered", RAYMELD_SAMPLING_CENTERED}});
    desc.max_memory_bytes = max_memory_bytes;
    desc.exposure = exposure;
    desc.adaptive_threshold = adaptive_threshold;
    desc.changed_only = changed_only;
    std::vector<const char*> absent;
    for (const std::string& layer : absent_layers) absent.push_back(layer.c_str());
    desc.absent_layer_count = uint32_t(absent.size());
    desc.absent_layers = absent.data();
    const py::gil_scoped_release released;
    raymeld_context_desc context;
    context.selector = device.c_str();
    fusion_ = std::make_unique<raymeld::Fusion>(raymeld::Context(context), *model, desc);
    info_ = fusion_->info();
    layers_ = fusion_->layers();
  }

  const std::vector<std::string>& layers() const { return layers_; }
  uint32_t scale() const { return info_.scale; }
  std::string precision() const { return info_.precision == RAYMELD_PRECISION_FP16 ? "fp16" : "fp32"; }
  uint64_t memory_bytes() {
    const py::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    return fusion_->info().memory_bytes;
  }
  py::dict status() {
    raymeld_status last;
    {
      const py::gil_scoped_release released;
      const std::lock_guard lock(mutex_);
      last = status_;
    }
    py::dict status;
    status["saturated"] = last.saturated;
    status["redone_tiles"] = last.redone_tiles;
    status["settled_share"] = last.settled_share;
    status["kept_share"] = last.kept_share;
    return status;
  }

  py::array_t<float> fuse(const Array& lrhs, const std::map<std::string, Array>& hrls) {
    const size_t full_height = size_t{height_} * scale(), full_width = size_t{width_} * scale();
    const size_t plane = full_height * full_width;
    std::vector<float> small(3 * size_t{height_} * width_), large, fused(3 * plane);
    copy_planes(lrhs, "lrhs", height_, width_, small.data());
    for (const std::string& layer : layers()) {
      const auto found = hrls.find(layer);
      if (found == hrls.end()) throw py::key_error("hrls has no '" + layer + "'");
      large.resize(large.size() + 3 * plane);
      copy_planes(found->second, "hrls['" + layer + "']", full_height, full_width,
                  large.data() + large.size() - 3 * plane);
    }
    {
      const py::gil_scoped_release released;
      const std::lock_guard lock(mutex_);
      status_ = fusion_->fuse(small.data(), large.data(), fused.data());
    }
    py::array_t<float> image({full_height, full_width, size_t{3}});
    auto pixels = image.mutable_unchecked<3>();
    const float* next = fused.data();
    for (py::ssize_t c = 0; c < 3; ++c)
      for (py::ssize_t y = 0; y < pixels.shape(0); ++y)
        for (py::ssize_t x = 0; x < pixels.shape(1); ++x) pixels(y, x, c) = *next++;
    return image;
  }

 private:
  uint32_t height_, width_;
  std::unique_ptr<raymeld::Fusion> fusion_;
  raymeld_fusion_info info_;  // of what does not change
  std::vector<std::string> layers_;
  // Threads of Python's take turns; who waits for it does not hold the interpreter's lock.
  std::mutex mutex_;
  raymeld_status status_;
};

}  // namespace

PYBIND11_MODULE(raymeld, module) {
  using raymeld::SharedModel;
  module.doc() =
      "Fuses a small render with many samples a pixel (LRHS) and a full-size one with few (HRLS) into the\n"
      "image that full size and many samples would have given, on a Vulkan device.\n\n"
      "    model = raymeld.Model('x4-fast')\n"
      "    fusion = raymeld.Fusion(model, height=128, width=128)\n"
      "    image = fusion.fuse(lrhs, {'color': color, 'albedo': albedo, 'normal': normal, ...})";
  const uint32_t version = raymeld_version();
  module.attr("__version__") = std::to_string(version >> 16) + "." + std::to_string(version >> 8 & 255) +
                               "." + std::to_string(version & 255);
  py::register_exception<raymeld::Failure>(module, "Error", PyExc_RuntimeError);

  module.def("list_models", &raymeld::list_models, "The names of the stock models.");
  py::class_<SharedModel, std::shared_ptr<SharedModel>>(
      module, "Model", "A network and its weights, for any number of fusions.")
      .def(py::init<const std::string&>(), py::arg("file"),
           "file: a safetensors file, or the name of a stock model, see list_models(). Raises Error.")
      .def_property_readonly("name", [](const SharedModel& model) { return model.info().name; })
      .def_property_readonly(
          "scale", [](const SharedModel& model) { return model.info().scale; },
          "Full-size pixels to one of LRHS, in each direction.")
      .def_property_readonly("layers", &SharedModel::layers, "Of HRLS, in order.")
      .def_property_readonly("optional_layers", &SharedModel::optional_layers,
                             "Those that the model was trained to do without.")
      .def_property_readonly("parameters", [](const SharedModel& model) { return model.info().parameters; });

  py::class_<Fuser>(
      module, "Fusion",
      "A model made ready for frames of one size on one device.\n\n"
      "height, width: of LRHS, in pixels. precision: 'auto', 'fp32' or 'fp16'. kernels: 'auto'\n"
      "or 'direct'. sampling: where LRHS samples lie, 'model', 'nearest' or 'centered'.\n"
      "max_memory_bytes: on the device; 0: what it has to give. exposure: 0: what suits the\n"
      "model. adaptive_threshold: blocks in which both renders agree to within this are not\n"
      "computed; 0: all are. changed_only: computes only what changed since the last frame.\n"
      "absent_layers: those of the model's optional layers that HRLS does not have. device: an\n"
      "index, a UUID or part of the name; '': the first GPU, else a driver for CPUs.\n"
      "Raises Error, and ValueError.")
      .def(py::init<std::shared_ptr<SharedModel>, uint32_t, uint32_t, const std::string&, const std::string&,
                    const std::string&, uint64_t, float, float, bool, const std::vector<std::string>&,
                    const std::string&>(),
           py::arg("model"), py::arg("height"), py::arg("width"), py::kw_only(),
           py::arg("precision") = "auto", py::arg("kernels") = "auto", py::arg("sampling") = "model",
           py::arg("max_memory_bytes") = 0, py::arg("exposure") = 0.0f, py::arg("adaptive_threshold") = 0.0f,
           py::arg("changed_only") = false, py::arg("absent_layers") = std::vector<std::string>{},
           py::arg("device") = "")
      .def("fuse", &Fuser::fuse, py::arg("lrhs"), py::arg("hrls"),
           "lrhs: (height, width, 3), hrls: {layer: (scale * height, scale * width, 3)} of all `layers`, "
           "scene\n"
           "linear. Returns (scale * height, scale * width, 3). Other threads run while the device works.\n"
           "Raises Error, ValueError and KeyError.")
      .def_property_readonly("layers", &Fuser::layers, "Of HRLS, that fuse() asks for.")
      .def_property_readonly("scale", &Fuser::scale)
      .def_property_readonly("precision", &Fuser::precision, "'fp32' or 'fp16'.")
      .def_property_readonly("memory_bytes", &Fuser::memory_bytes, "On the device, so far.")
      .def_property_readonly(
          "status", &Fuser::status,
          "Of the last frame: saturated, values that fp16 could not hold; redone_tiles,\n"
          "computed again in fp32 for that; settled_share and kept_share, of the frame that\n"
          "needed no network, by adaptive_threshold and changed_only.");
}

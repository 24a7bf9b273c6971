// Wraps the library for Python; images are NumPy arrays of (height, width, channels).
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <raymeld/raymeld.hpp>
#include <span>
#include <string_view>
#include <vector>

namespace py = pybind11;

namespace {

using Array = py::array_t<float, py::array::forcecast>;

std::string text_of(const std::vector<py::ssize_t>& shape) { return py::str(py::tuple(py::cast(shape))); }

// Copies an image of (height, width, channels) to `planes`, channel by channel. Throws ValueError for other
// shapes.
void copy_planes(const Array& image, const std::string& name, size_t height, size_t width, float* planes,
                 py::ssize_t channels = 3) {
  const std::vector<py::ssize_t> shape(image.shape(), image.shape() + image.ndim()),
      expected{py::ssize_t(height), py::ssize_t(width), channels};
  if (shape != expected)
    throw py::value_error(name + " has the shape " + text_of(shape) + ", expected " + text_of(expected));
  const auto pixels = image.unchecked<3>();
  for (py::ssize_t c = 0; c < channels; ++c)
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

// Returns `pixels` as a side of LRHS. Throws ValueError if it is out of range.
uint32_t side(int64_t pixels, const char* name) {
  constexpr int64_t kMost = 65536;  // the limit of raymeld.h
  if (pixels >= 1 && pixels <= kMost) return uint32_t(pixels);
  throw py::value_error(std::string(name) + " is " + std::to_string(pixels) + ", expected 1 to " +
                        std::to_string(kMost) + " pixels of LRHS");
}

bool contains(const std::vector<std::string>& texts, const std::string& text) {
  return std::ranges::find(texts, text) != texts.end();
}

std::string joined(const std::vector<std::string>& texts) {
  std::string all;
  for (const std::string& text : texts) all += (all.empty() ? "" : ", ") + text;
  return all;
}

std::string repr_of(const raymeld::SharedModel& model) {
  const raymeld_model_info info = model.info();
  return "<raymeld.Model '" + std::string(info.name) + "', scale " + std::to_string(info.scale) + ", reads " +
         joined(model.layers()) + ">";
}

// Implements the Python class Fusion, which fuses frames of one size.
class Fuser {
 public:
  Fuser(std::shared_ptr<raymeld::SharedModel> model, int64_t height, int64_t width,
        const std::string& precision, const std::string& kernels, const std::string& sampling, float lrhs_spp,
        float hrls_spp, uint64_t max_memory_bytes, float exposure, bool skip_unchanged, bool temporal,
        bool motion_depth, const std::vector<std::string>& absent_layers, const std::string& device)
      : model_(std::move(model)),
        height_(side(height, "height")),
        width_(side(width, "width")),
        absent_layers_(absent_layers) {
    raymeld_fusion_desc& desc = desc_;
    desc.height = height_;
    desc.width = width_;
    desc.compute_variance = VK_TRUE;
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
    desc.lrhs_spp = lrhs_spp;
    desc.hrls_spp = hrls_spp;
    desc.max_memory_bytes = max_memory_bytes;
    desc.exposure = exposure;
    desc.skip_unchanged = skip_unchanged;
    desc.temporal = temporal;
    desc.motion_depth = motion_depth;
    for (const std::string& layer : absent_layers_) absent_.push_back(layer.c_str());
    desc.absent_layer_count = uint32_t(absent_.size());
    desc.absent_layers = absent_.data();
    const py::gil_scoped_release released;
    raymeld_context_desc context;
    context.selector = device.c_str();
    context_.emplace(context);
    fusion_.emplace(*context_, *model_, desc);
    info_ = fusion_->info();
    layers_ = fusion_->layers();
    reads_variance_ = contains(model_->layers(), "variance") && !contains(absent_layers_, "variance");
  }

  const std::vector<std::string>& layers() const { return layers_; }
  uint32_t scale() const { return info_.scale; }
  std::string precision() const { return info_.precision == RAYMELD_PRECISION_FP16 ? "fp16" : "fp32"; }
  uint64_t memory_bytes() {
    const py::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    return fusion_ ? fusion_->info().memory_bytes : 0;
  }
  std::string repr() const {
    const bool reads_lrhs = model_->info().reads_lrhs;
    return "<raymeld.Fusion of '" + std::string(model_->info().name) + (reads_lrhs ? "', LRHS of " : "', ") +
           std::to_string(height_) + " x " + std::to_string(width_) + " pixels (height x width), " +
           precision() + ">";
  }
  void reset_history() {
    const py::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    temporal().reset_history();
  }
  py::bytes save_history() {
    std::vector<std::byte> data;
    {
      const py::gil_scoped_release released;
      const std::lock_guard lock(mutex_);
      data = temporal().save_history();
    }
    return {reinterpret_cast<const char*>(data.data()), data.size()};
  }
  void load_history(const py::bytes& data) {
    const std::string_view bytes = data;
    const py::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    temporal().load_history(std::as_bytes(std::span(bytes)));
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
    status["skipped_share"] = last.skipped_share;
    return status;
  }

  py::array_t<float> fuse(const std::optional<Array>& lrhs, const std::map<std::string, Array>& hrls,
                          const std::optional<Array>& motion) {
    const size_t full_height = size_t{height_} * scale(), full_width = size_t{width_} * scale();
    const size_t plane = full_height * full_width;
    std::vector<float> small(lrhs ? 3 * size_t{height_} * width_ : 0), large, fused(3 * plane);
    if (lrhs) copy_planes(*lrhs, "lrhs", height_, width_, small.data());
    const uint32_t channels = desc_.motion_depth ? 4 : 2;
    std::vector<float> moved(motion ? channels * plane : 0);
    if (motion) copy_planes(*motion, "motion", full_height, full_width, moved.data(), channels);
    std::vector<std::string> needed = layers();
    const bool given_variance = reads_variance_ && hrls.contains("variance");
    if (given_variance && desc_.temporal)
      throw py::value_error("hrls has a variance, which a temporal fusion computes");
    if (given_variance) needed = model_layers_with_variance();
    for (const std::string& layer : needed) {
      const auto found = hrls.find(layer);
      if (found == hrls.end()) throw py::key_error("hrls has no '" + layer + "'");
      large.resize(large.size() + 3 * plane);
      copy_planes(found->second, "hrls['" + layer + "']", full_height, full_width,
                  large.data() + large.size() - 3 * plane);
    }
    {
      const py::gil_scoped_release released;
      const std::lock_guard lock(mutex_);
      if (!fusion_ || desc_.compute_variance == VkBool32(given_variance)) {
        fusion_.reset();
        desc_.compute_variance = !given_variance;
        fusion_.emplace(*context_, *model_, desc_);
      }
      status_ = fusion_->fuse_next(lrhs ? small.data() : nullptr, large.data(),
                                   motion ? moved.data() : nullptr, fused.data());
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
  // Returns the fusion, which is made once where it is temporal.
  raymeld::Fusion& temporal() {
    if (!desc_.temporal) throw py::value_error("the fusion keeps no history, as it is not temporal");
    return *fusion_;
  }
  // Returns the layers of an HRLS that holds the variance, in the model's order.
  std::vector<std::string> model_layers_with_variance() const {
    std::vector<std::string> layers = model_->layers();
    std::erase_if(layers, [&](const std::string& layer) { return contains(absent_layers_, layer); });
    return layers;
  }

  std::shared_ptr<raymeld::SharedModel> model_;
  uint32_t height_, width_;
  std::vector<std::string> absent_layers_;
  std::vector<const char*> absent_;
  raymeld_fusion_desc desc_;
  std::optional<raymeld::Context> context_;
  // fuse() makes it again where HRLS holds a variance and the last HRLS did not, or the other way round.
  std::optional<raymeld::Fusion> fusion_;
  raymeld_fusion_info info_;         // scale and precision, which do not change
  std::vector<std::string> layers_;  // the layers of HRLS, but not the variance
  bool reads_variance_ = false;
  // Threads of Python take turns; one that waits for the mutex does not hold the interpreter's lock.
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

  module.def("list_models", &raymeld::list_models, "Returns the names of the stock models.");
  module.def(
      "devices", &raymeld::device_names,
      "Returns the names of the system's devices; Fusion takes an index among them, or part of a name.");
  py::class_<SharedModel, std::shared_ptr<SharedModel>>(
      module, "Model", "A network and its weights, for any number of fusions.")
      .def(py::init([](const std::filesystem::path& file) {
             return std::make_shared<SharedModel>(file.string());
           }),
           py::arg("file"),
           "file is the path of a safetensors file, or the name of a stock model, see list_models().\n"
           "Raises Error.")
      .def("__repr__", &repr_of)
      .def_property_readonly("name", [](const SharedModel& model) { return model.info().name; })
      .def_property_readonly(
          "scale", [](const SharedModel& model) { return model.info().scale; },
          "Full-size pixels for each pixel of LRHS, in each direction; 1 if the model reads no LRHS.")
      .def_property_readonly("layers", &SharedModel::layers,
                             "The layers of HRLS that the model reads, in order.")
      .def_property_readonly("optional_layers", &SharedModel::optional_layers,
                             "The layers that the model was trained to do without.")
      .def_property_readonly("parameters", [](const SharedModel& model) { return model.info().parameters; });

  py::class_<Fuser>(
      module, "Fusion",
      "A model made ready for frames of one size on one device.\n\n"
      "height and width are those of LRHS, in pixels, at most 65536. precision is 'auto', 'fp32'\n"
      "or 'fp16', and kernels 'auto' or 'direct'. sampling says where LRHS samples lie: 'model',\n"
      "'nearest' or 'centered'. lrhs_spp and hrls_spp are the samples a pixel of both renders, for models\n"
      "that know them; 0 stands for scale^2 and 1. max_memory_bytes limits the memory taken on the device; 0 "
      "allows all\n"
      "that it has to give. With an exposure of 0, each frame gets the exposure that suits the model.\n"
      "skip_unchanged computes only the tiles that changed since the last frame. temporal joins each frame\n"
      "with the ones before it, by the motion that fuse() then takes; with motion_depth it has depths.\n"
      "absent_layers are the optional layers of the model that HRLS does not have. device is an index of\n"
      "devices(), a UUID or part of a name; '' is the first GPU, else a driver for CPUs.\n"
      "Raises Error and ValueError.")
      .def(py::init<std::shared_ptr<SharedModel>, int64_t, int64_t, const std::string&, const std::string&,
                    const std::string&, float, float, uint64_t, float, bool, bool, bool,
                    const std::vector<std::string>&, const std::string&>(),
           py::arg("model"), py::arg("height"), py::arg("width"), py::kw_only(),
           py::arg("precision") = "auto", py::arg("kernels") = "auto", py::arg("sampling") = "model",
           py::arg("lrhs_spp") = 0.0f, py::arg("hrls_spp") = 0.0f, py::arg("max_memory_bytes") = 0,
           py::arg("exposure") = 0.0f, py::arg("skip_unchanged") = false, py::arg("temporal") = false,
           py::arg("motion_depth") = false, py::arg("absent_layers") = std::vector<std::string>{},
           py::arg("device") = "")
      .def("__repr__", &Fuser::repr)
      .def(
          "fuse", &Fuser::fuse, py::arg("lrhs"), py::arg("hrls"), py::arg("motion") = py::none(),
          "lrhs is (height, width, 3) and hrls {layer: (scale * height, scale * width, 3)} of all `layers`,\n"
          "scene linear. A model of scale 1 reads HRLS alone, and lrhs must be None. A model that reads the\n"
          "variance takes it from hrls, or else computes it from the color.\n"
          "With temporal, motion (scale * height, scale * width, 2) leads from each pixel to the same point "
          "in\n"
          "the last frame, in pixels to the right and downwards. With motion_depth it has four channels: "
          "also\n"
          "the depth of that point in this frame and in the last one, which may be the same.\n"
          "Returns (scale * height, scale * width, 3). Other threads run while the device works.\n"
          "Raises Error, ValueError and KeyError.")
      .def("reset_history", &Fuser::reset_history,
           "Makes the next frame the first one of a sequence, as after a cut; with temporal.")
      .def("save_history", &Fuser::save_history,
           "Returns as bytes what the last frame left for the next one; with temporal. Raises Error\n"
           "and ValueError.")
      .def("load_history", &Fuser::load_history, py::arg("history"),
           "Makes the next frame go on with what save_history() returned for frames of the same size, scale\n"
           "and layers. Raises Error and ValueError.")
      .def_property_readonly("layers", &Fuser::layers, "The layers of HRLS that fuse() asks for.")
      .def_property_readonly("scale", &Fuser::scale)
      .def_property_readonly("precision", &Fuser::precision, "'fp32' or 'fp16'.")
      .def_property_readonly("memory_bytes", &Fuser::memory_bytes, "The memory taken on the device so far.")
      .def_property_readonly(
          "status", &Fuser::status,
          "The status of the last frame: saturated is the number of values that fp16 could not hold,\n"
          "redone_tiles the number of tiles that were computed again in fp32 for that, and skipped_share\n"
          "the share of the frame's work that was skipped with skip_unchanged, because nothing changed "
          "there.");
}

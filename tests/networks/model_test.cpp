#include "networks/model.h"

#include <gtest/gtest.h>

#include <limits>

#include "error_of.h"
#include "golden.h"
#include "io/safetensors.h"
#include "support.h"

namespace raymeld::test {
namespace {

class ModelTest : public testing::Test {
 protected:
  // Returns the error of loading the tiny x4 model after `change`.
  template <typename Change>
  std::string error_after(Change&& change) {
    SafeTensors content = read_safetensors(golden_model_path(4));
    change(content);
    write_safetensors(file_, content);
    const std::string message = error_of([&] { Model model(file_); });
    EXPECT_TRUE(contains(message, file_.string())) << message;
    return message;
  }

  // Returns the error of loading a golden model with an entry of its metadata changed.
  std::string error_with(const std::string& golden, const std::string& key, const std::string& value) {
    SafeTensors content = read_safetensors(golden_model_path(golden));
    content.metadata[key] = value;
    write_safetensors(file_, content);
    return error_of([&] { Model model(file_); });
  }

  TemporaryDirectory folder_;
  std::filesystem::path file_ = folder_ / "broken.safetensors";
};

TEST_F(ModelTest, TheGoldenModelsLoad) {
  const Model model(golden_model_path(4));
  const Architecture& a = model.architecture();
  EXPECT_EQ(model.name(), "tiny-x4");
  EXPECT_EQ(model.file(), golden_model_path(4).string());
  EXPECT_EQ(model.metadata().at("license"), "CC-BY-4.0");
  EXPECT_EQ(a.scale, 4u);
  EXPECT_EQ(a.levels(), 2u);
  EXPECT_EQ(a.features, 5u);
  EXPECT_EQ(a.growth, 3u);
  EXPECT_EQ(a.dense_layers, 3u);
  EXPECT_EQ(a.blocks, 1u);
  EXPECT_EQ(a.groups, 2u);
  EXPECT_EQ(a.hrls_layers, (std::vector<std::string>{"color", "normal", "albedo"}));
  EXPECT_EQ(kind_of("color"), ChannelKind::kRadiance);
  EXPECT_EQ(kind_of("normal"), ChannelKind::kNormal);
  EXPECT_EQ(kind_of("albedo"), ChannelKind::kAlbedo);
  EXPECT_EQ(a.long_skip, LongSkip::kFused);
  EXPECT_TRUE(a.merge_relu);
  EXPECT_EQ(a.transfer, Transfer::kLog);
  EXPECT_EQ(a.clip, 1000);
  EXPECT_TRUE(a.has_base);
  EXPECT_EQ(a.hrls_encoder, HrlsEncoder::kFull);
  EXPECT_EQ(a.upscale, Upscale::kStages);
  EXPECT_EQ(a.upscaled_features, 5u);
  EXPECT_FALSE(a.hrls_guide);
  EXPECT_EQ(a.head_features, 0u);
  EXPECT_EQ(a.head_layers, 0u);
  EXPECT_TRUE(a.optional_layers.empty());
  EXPECT_TRUE(a.trained_on(false));
  EXPECT_FALSE(a.trained_on(true));
  EXPECT_EQ(Model(golden_model_path(2)).architecture().levels(), 1u);
  EXPECT_EQ(Model(golden_model_path(8)).architecture().levels(), 3u);
}

TEST_F(ModelTest, TheOtherChoicesOfTheNetworkAreRead) {
  const Architecture a = Model(golden_model_path("guided-x4")).architecture();
  EXPECT_EQ(a.hrls_encoder, HrlsEncoder::kUnshuffled);
  EXPECT_EQ(a.upscale, Upscale::kDirect);
  EXPECT_EQ(a.upscaled_features, 3u);
  EXPECT_TRUE(a.hrls_guide);
  EXPECT_EQ(a.head_features, 6u);
  EXPECT_EQ(a.head_layers, 2u);
  EXPECT_EQ(a.optional_layers, (std::vector<std::string>{"albedo", "variance"}));
  EXPECT_FALSE(a.lrhs_centered);
  EXPECT_TRUE(a.trained_on(true));
  EXPECT_TRUE(a.trained_on(false));
  EXPECT_TRUE(Model(golden_model_path("guided-x2")).architecture().lrhs_centered);
  EXPECT_FALSE(Model(golden_model_path("guided-x8")).architecture().has_base);
  EXPECT_EQ(Model(golden_model_path("spp-x4")).architecture().hrls_kernel, 1u);
  EXPECT_FALSE(read_safetensors(golden_model_path("guided-x4")).metadata.contains("hrls_kernel"));
  EXPECT_EQ(Model(golden_model_path("guided-x4")).architecture().hrls_kernel, 3u);
  EXPECT_EQ(Model(golden_model_path("pyramid-x4")).architecture().lrhs_certainty, 10);
}

TEST_F(ModelTest, AModelThatKnowsSamplesHasBiasesForThem) {
  EXPECT_FALSE(Model(golden_model_path("guided-x4")).architecture().knows_spp);
  EXPECT_TRUE(Model(golden_model_path("spp-x4")).architecture().knows_spp);
  for (const char* layer : {"lrhs.by_spp", "hrls.by_spp"}) {
    SafeTensors content = read_safetensors(golden_model_path("spp-x4"));
    content.tensors.erase(layer);
    write_safetensors(file_, content);
    const std::string message = error_of([&] { Model model(file_); });
    EXPECT_TRUE(contains(message, layer)) << message;
  }
  SafeTensors content = read_safetensors(golden_model_path("spp-x4"));
  content.metadata["knows_spp"] = "false";
  write_safetensors(file_, content);
  const std::string message = error_of([&] { Model model(file_); });
  EXPECT_TRUE(contains(message, "belongs to no layer")) << message;
}

TEST_F(ModelTest, ABiasForCenteredSamplesBelongsToBothSamplings) {
  SafeTensors content = read_safetensors(golden_model_path("guided-x4"));
  const auto error_now = [&] {
    write_safetensors(file_, content);
    return error_of([&] { Model model(file_); });
  };
  content.metadata["lrhs_sampling"] = "centered";
  EXPECT_TRUE(contains(error_now(), "tensor lrhs.centered_bias"));
  content.metadata["lrhs_sampling"] = "centered,nearest";
  write_safetensors(file_, content);
  EXPECT_NO_THROW(Model{file_});
  content.tensors.erase("lrhs.centered_bias");
  EXPECT_TRUE(contains(error_now(), "tensor lrhs.centered_bias of shape [5] is missing"));
}

TEST_F(ModelTest, EveryEntryIsNeeded) {
  for (const char* key :
       {"format", "format_version", "scale",         "features",        "growth",      "dense_layers",
        "blocks", "groups",         "hrls_layers",   "long_skip",       "merge_relu",  "transfer",
        "clip",   "base",           "lrhs_sampling", "hrls_encoder",    "upscale",     "upscaled_features",
        "guide",  "head_features",  "head_layers",   "optional_layers", "exposure_key"}) {
    const std::string message = error_after([&](SafeTensors& content) { content.metadata.erase(key); });
    EXPECT_TRUE(contains(message, fmt::format("\"{}\" is missing", key))) << message;
  }
}

TEST_F(ModelTest, APyramidHasWidthsAndGuides) {
  const Architecture a = Model(golden_model_path("pyramid-x2")).architecture();
  EXPECT_TRUE(a.is_pyramid());
  EXPECT_EQ(a.widths, (std::vector<uint32_t>{3, 2, 3, 2}));
  EXPECT_EQ(a.upscaled_features, 3u);
  EXPECT_EQ(a.grid(), 8u);
  EXPECT_EQ(Model(golden_model_path("pyramid-x4")).architecture().grid(), 4u);
  const auto error = [&](const std::string& key, const std::string& value) {
    return error_with("pyramid-x2", key, value);
  };
  for (const char* widths : {"", "3,2,3", "3,2,3,2,1", "3,2,0,2", "3,2,x,2", "3,2,3,2,"})
    EXPECT_TRUE(contains(error("widths", widths), "expected 4 integers from 1 to 1024")) << widths;
  EXPECT_TRUE(contains(error("widths", "3,2,3,4"), "tensor down.4.weight has shape"));
  for (const char* key : {"widths", "lrhs_certainty"}) {
    SafeTensors content = read_safetensors(golden_model_path("pyramid-x2"));
    content.metadata.erase(key);
    write_safetensors(file_, content);
    EXPECT_ERROR(Model{file_}, fmt::format("\"{}\" is missing", key));
  }
  for (const char* certainty : {"", "-1", "inf", "nan", "1e99", "16 "})
    EXPECT_TRUE(contains(error("lrhs_certainty", certainty), "\"lrhs_certainty\"")) << certainty;
  EXPECT_TRUE(
      contains(error("network", "unet"), "one of \"fusion\", \"pyramid\", \"edsr\", \"rcan\", \"kpcn\""));
  for (const char* scale : {"0", "9"})
    EXPECT_TRUE(contains(error("scale", scale), "expected an integer from 1 to 8")) << scale;
  EXPECT_TRUE(contains(error("scale", "3"), "expected 1, 2, 4 or 8"));
  // At a scale of 1 no layer reads LRHS.
  EXPECT_TRUE(contains(error("scale", "1"), "tensor level.1.weight of shape [3, 3, 3, 3] is missing"));
  SafeTensors content = read_safetensors(golden_model_path("pyramid-x1"));
  content.tensors["lrhs.by_spp"] = content.tensors.at("hrls.by_spp");
  write_safetensors(file_, content);
  EXPECT_TRUE(contains(error_of([&] { Model model(file_); }), "tensor lrhs.by_spp belongs to no layer"));
  EXPECT_TRUE(contains(error("hrls_layers", "color,normal,albedo,variance"), "color,albedo,normal first"));
}

TEST_F(ModelTest, EdsrReadsLrhsAlone) {
  const Architecture a = Model(golden_model_path("edsr-x4")).architecture();
  EXPECT_FALSE(a.reads_hrls());
  EXPECT_TRUE(a.hrls_layers.empty());
  EXPECT_TRUE(a.lrhs_centered);
  const auto error = [&](const std::string& key, const std::string& value) {
    return error_with("edsr-x4", key, value);
  };
  EXPECT_TRUE(contains(error("scale", "1"), "\"scale\" is \"1\""));
  EXPECT_TRUE(contains(error("blocks", "0"), "\"blocks\" is \"0\", expected an integer from 1 to 64"));
  EXPECT_TRUE(contains(error("blocks", "1"), "tensor blocks.1.0.bias belongs to no layer"));
  EXPECT_TRUE(contains(error("features", "6"), "tensor head.weight has shape"));
  EXPECT_TRUE(contains(error("lrhs_sampling", "nearest,centered"), "\"centered\" or \"nearest\""));
}

TEST_F(ModelTest, RcanHasAttention) {
  const Architecture a = Model(golden_model_path("rcan-x2")).architecture();
  EXPECT_FALSE(a.reads_hrls());
  EXPECT_FALSE(a.lrhs_centered);
  const auto error = [&](const std::string& key, const std::string& value) {
    return error_with("rcan-x2", key, value);
  };
  EXPECT_TRUE(contains(error("groups", "1"), "tensor groups.1.blocks.0.0.bias belongs to no layer"));
  EXPECT_TRUE(contains(error("squeezed_features", "3"), "tensor groups.0.blocks.0.squeeze.weight has shape"));
  EXPECT_TRUE(contains(error("squeezed_features", "0"), "expected an integer from 1 to 1024"));
}

TEST_F(ModelTest, KpcnReadsHrlsAlone) {
  const Architecture a = Model(golden_model_path("kpcn-x1")).architecture();
  EXPECT_FALSE(a.reads_lrhs());
  EXPECT_TRUE(a.reads_hrls());
  const auto error = [&](const std::string& key, const std::string& value) {
    return error_with("kpcn-x1", key, value);
  };
  EXPECT_TRUE(contains(error("scale", "2"), "expected 1, as the network denoises"));
  EXPECT_TRUE(contains(error("kernel_side", "6"), "expected an odd number"));
  EXPECT_TRUE(contains(error("kernel_side", "9"), "tensor kernel.diffuse.weight has shape"));
  EXPECT_TRUE(contains(error("depth", "1"), "expected an integer from 2 to 64"));
  EXPECT_TRUE(contains(error("knows_spp", "true"), "expected \"false\""));
  EXPECT_TRUE(contains(error("hrls_layers", "color,normal,albedo,diffuse"), "color,albedo,normal,diffuse"));
}

TEST_F(ModelTest, WrongEntriesAreNamed) {
  const std::map<std::string, std::vector<std::string>> wrong{
      {"format", {"", "raymeld", "onnx"}},
      {"format_version", {"2", "1.0", ""}},
      {"scale", {"1", "3", "0", "16", "-4", "4.0", "four", "", " 4"}},
      {"features", {"0", "-1", "1025", "5x", "99999999999999999999", ""}},
      {"growth", {"0", "1025", "3.5"}},
      {"dense_layers", {"0", "65"}},
      {"blocks", {"0", "65"}},
      {"groups", {"0", "65"}},
      {"hrls_layers",
       {"", "albedo,color", "color,colour", "color,,normal", "color,albedo,albedo", "color,",
        "color, normal"}},
      {"long_skip", {"", "both", "Lrhs"}},
      {"merge_relu", {"", "1", "True", "yes"}},
      {"transfer", {"", "pu", "Log"}},
      {"clip", {"0", "-1", "inf", "nan", "", "100 ", "1e99"}},
      {"base", {"", "bicubic"}},
      {"lrhs_sampling", {"", "centre", "nearest,", "nearest,nearest", "nearest, centered"}},
      {"hrls_encoder", {"", "half", "unshuffled "}},
      {"hrls_kernel", {"", "2", "5", "3 ", "1"}},  // 1 is refused as HRLS is not unshuffled
      {"upscale", {"", "stage", "Direct"}},
      {"upscaled_features", {"", "0", "-5", "4", "1025"}},
      {"guide", {"", "lrhs", "color"}},
      {"head_features", {"", "-1", "1025", "2.5", "3"}},
      {"head_layers", {"", "-1", "65", "1"}},
      {"optional_layers", {"color", "depth", "diffuse", "albedo,albedo", "albedo,", "albedo, normal"}},
      {"exposure_key", {"", "-0.1", "inf", "nan", "auto", "1e99"}},
  };
  for (const auto& [key, values] : wrong) {
    for (const std::string& value : values) {
      const std::string message =
          error_after([&, &key = key](SafeTensors& content) { content.metadata[key] = value; });
      EXPECT_TRUE(contains(message, key)) << key << " = \"" << value << "\": " << message;
    }
  }
}

TEST_F(ModelTest, EveryTensorIsNeeded) {
  for (const auto& [key, data] : read_safetensors(golden_model_path(4)).tensors) {
    const std::string message =
        error_after([&, &key = key](SafeTensors& content) { content.tensors.erase(key); });
    EXPECT_TRUE(contains(message, "tensor " + key)) << key << ": " << message;
    EXPECT_TRUE(contains(message, "missing")) << message;
  }
}

TEST_F(ModelTest, TensorsThatBelongToNoLayerAreNamed) {
  for (const char* key : {"groups.0.blocks.1.merge.weight", "down.2.bias", "extra", "decode.weight", "rec"}) {
    const std::string message = error_after([&](SafeTensors& content) {
      content.tensors[key] = {TensorType::kF32, {1}, {0}};
    });
    EXPECT_TRUE(contains(message, fmt::format("tensor {}", key))) << message;
  }
}

TEST_F(ModelTest, WrongShapesAreNamed) {
  for (const char* key : {"rec.weight", "groups.1.blocks.0.dense.2.weight", "fuse.bias", "up.1.weight"}) {
    const std::string longer = error_after([&](SafeTensors& content) {
      TensorData& data = content.tensors.at(key);
      ++data.shape.front();
      data.values.resize(data.values.size() / (data.shape.front() - 1) * data.shape.front());
    });
    EXPECT_TRUE(contains(longer, fmt::format("tensor {} has shape", key))) << longer;
    const std::string flat = error_after([&](SafeTensors& content) {
      TensorData& data = content.tensors.at(key);
      data.shape = {data.values.size(), 1};
    });
    EXPECT_TRUE(contains(flat, fmt::format("tensor {} has shape", key))) << flat;
  }
}

TEST_F(ModelTest, ValuesThatAreNotFiniteAreNamed) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    const std::string message =
        error_after([&](SafeTensors& content) { content.tensors.at("up.1.bias").values.back() = bad; });
    EXPECT_TRUE(contains(message, "tensor up.1.bias")) << message;
    EXPECT_TRUE(contains(message, "not finite")) << message;
  }
}

TEST_F(ModelTest, HalvesAreRead) {
  SafeTensors content = read_safetensors(golden_model_path(4));
  for (auto& [key, data] : content.tensors) data.type = TensorType::kF16;
  content.tensors.at("rec.weight").values[7] = 0.1f;
  write_safetensors(file_, content);
  const Model half(file_);
  EXPECT_EQ(half.parameters(), Model(golden_model_path(4)).parameters());
  EXPECT_EQ(half.conv("rec", 3, 5, 3).weight[7], 0x1.998p-4f);  // the half nearest to 0.1
}

TEST_F(ModelTest, NoSuchFile) { EXPECT_ERROR(Model(folder_ / "absent.safetensors"), "absent.safetensors"); }

}  // namespace
}  // namespace raymeld::test

// Tests that any error gives exit status 2, a message that names the cause, and no new file.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>

#include <csignal>

#include "cli_fixture.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;

class CliErrors : public Cli {
 protected:
  void expect_error(const std::vector<std::string>& arguments, const std::vector<std::string>& texts,
                    int status = 2) {
    check(run(arguments), texts, status);
  }
  // Runs the program through a shell, for limits and redirections.
  void expect_shell_error(const std::string& script, const std::vector<std::string>& arguments,
                          const std::vector<std::string>& texts) {
    std::vector<std::string> argv = {"sh", "-c", script, "sh", RAYMELD_PROGRAM};
    argv.insert(argv.end(), arguments.begin(), arguments.end());
    check(run_process(argv, {.directory = folder_.path(), .environment = environment_}), texts, 2);
  }
  void SetUp() override {
    Cli::SetUp();
    before_ = files();
  }
  void remember_files() { before_ = files(); }

  void check(const ProcessResult& result, const std::vector<std::string>& texts, int status) {
    EXPECT_EQ(result.exit_status, status) << result.err;
    EXPECT_EQ(result.out, "");
    for (const std::string& text : texts)
      EXPECT_NE(result.err.find(text), std::string::npos) << "'" << text << "' in: " << result.err;
    EXPECT_EQ(files(), before_);
  }

 private:
  std::set<std::string> before_;
};

TEST_F(CliErrors, Usage) {
  expect_error({}, {"raymeld: error: ", "subcommand"});
  expect_error({"melt"}, {"raymeld: error: ", "'melt'"});
  expect_error({"fuse", "--lrhs", "low.exr"}, {"--hrls"});
  expect_error({"fuse", "--lrhs", "low.exr", "--hrls", "high.exr"}, {"--output"});
  expect_error(fuse({"--precision", "fp8"}), {"--precision", "fp16"});
  expect_error(fuse({"--max-memory", "-3"}), {"--max-memory"});
  expect_error(fuse({"--exposure", "nan"}), {"--exposure", "not finite"});
  for (const char* bad : {"on", "1x", "", "0", "-1", "nan", "1e9"})
    expect_error(fuse({"--input-exposure", bad}), {"--input-exposure", bad});
  expect_error({"degrade", "high.exr", "--scale", "3", "-o", "out.exr"}, {"--scale"});
  expect_error({"graph", "--model", tiny_model(), "--size", "64"}, {"--size", "'64'", "WxH"});
  expect_error({"graph", "--model", tiny_model(), "--size", "66x48"}, {"66x48", "scale 4"});
  expect_error({"tune", "--model", tiny_model(), "--size", "66x48"}, {"66x48", "scale 4"});
  for (const char* command : {"graph", "compile", "tune"})
    expect_error({command, "--model", tiny_model(), "--size", "4000000000x64"},
                 {"1000000000 x 16", "to 65536"});
  expect_error({"compile", "--model", tiny_model(), "--size", "64x48", "--precision", "fp32", "--matrices"},
               {"cooperative matrices"});
  for (const char* views : {"0", "-3", "two"})
    expect_error({"trade", "--data", "none", "--views", views}, {"--views", views});
  for (const char* bad : {"-1", "nan", "soon"}) expect_error({"tune", "--seconds", bad}, {"--seconds", bad});
  expect_error({"tune", "--precision", "int8"}, {"--precision", "fp16"});
  expect_error({"conform", "--suite", "poetry"}, {"--suite", "conv2d"});
  expect_error({"conform", "--quick", "--full"}, {"--quick", "--full"});
  expect_error({"conform", "--against", "low.exr"}, {"low.exr", "--values"});
  expect_error({"conform", "--suite", "network", "--values", "no/folder/v.json"}, {"no/folder/v.json"});
  expect_error(fuse({"--kernels", "fastest"}), {"--kernels", "direct"});
  expect_error(fuse({"--map", "shine=R"}), {"shine", "albedo"});
}

TEST_F(CliErrors, ASwappedPairIsCalledSo) {
  expect_error({"fuse", "--lrhs", "high.exr", "--hrls", "low.exr", "-o", "out.exr"},
               {"LRHS 'high.exr' is 32 x 24", "HRLS 'low.exr' is 8 x 6", "exchanged"});
}

TEST_F(CliErrors, SizesThatDoNotFit) {
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 9, 6, 1));
  expect_error(fuse(), {"low.exr", "9 x 6", "high.exr", "32 x 24", "36 x 24 for x4"});
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 16, 12, 1));
  expect_error(fuse(), {"16 x 12", "64 x 48 for x4"});
  // The scale is 3, and no model is named.
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 48, 36, 2));
  expect_error({"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "-o", "out.exr"},
               {"16 x 12", "48 x 36", "32 x 24 for x2", "64 x 48 for x4", "128 x 96 for x8"});
  expect_error({"compare", "low.exr", "high.exr"}, {"low.exr", "16 x 12", "high.exr", "48 x 36"});
  expect_error(fuse({"--reference", "low.exr"}), {"16 x 12"});
  expect_error({"degrade", "high.exr", "--scale", "8", "-o", "out.exr"}, {"high.exr", "48 x 36", "8"});
}

TEST_F(CliErrors, InputFiles) {
  expect_error({"fuse", "--lrhs", "none.exr", "--hrls", "high.exr", "-o", "out.exr"},
               {"none.exr", "no such file"});
  expect_error({"fuse", "--lrhs", "low.exr", "--hrls", ".", "-o", "out.exr"}, {"'.'", "folder"});
  expect_error(fuse({"--reference", "."}), {"folder"});
  const std::string whole = read_file(folder_ / "high.exr");
  for (const size_t size : {whole.size() / 2, whole.size() - 1, size_t{100}}) {
    write_file(folder_ / "high.exr", whole.substr(0, size));
    expect_error(fuse(), {"cannot read 'high.exr'"});
  }
  write_file(folder_ / "high.exr", "plain text");
  expect_error(fuse(), {"high.exr", "OpenEXR"});
}

TEST_F(CliErrors, LayersThatAreMissingAreNamed) {
  write_image(folder_ / "high.exr", kColorNames, random_image(kColorNames, 32, 24, 2));
  expect_error(fuse(), {"high.exr", "normal", "albedo", "Denoising Albedo"});
  expect_error(fuse({"--map", "albedo=paint"}), {"high.exr", "paint"});
  expect_error(fuse({"--map", "blender"}), {"blender", "cycles"});
  write_image(folder_ / "low.exr", {"a.R", "b.R"}, random_image({"a.R", "b.R"}, 8, 6, 2));
  expect_error(fuse(), {"low.exr", "color", "--map-lrhs"});
}

// Writes parts of 32 x 24 black pixels, and one, "extra", of half that width.
void write_parts(const fs::path& path) {
  std::vector<Imf::Header> headers;
  for (const char* name : {"beauty", "albedo", "normal", "extra"}) {
    const Imath::Box2i whole = window(0, 0, 32, 24), half = window(0, 0, 16, 24);
    headers.emplace_back(whole, std::string(name) == "extra" ? half : whole);
    headers.back().setName(name);
    headers.back().setType(Imf::SCANLINEIMAGE);
    for (const std::string& color : kColorNames) headers.back().channels().insert(color, Imf::Channel());
  }
  Imf::MultiPartOutputFile file(path.c_str(), headers.data(), int(headers.size()));
  const std::vector<uint16_t> black(32 * 24);
  for (int part = 0; part < file.parts(); ++part) {
    Imf::FrameBuffer frame;
    for (const std::string& color : kColorNames)
      frame.insert(color, Imf::Slice::Make(Imf::HALF, black.data(), headers[size_t(part)].dataWindow()));
    Imf::OutputPart output(file, part);
    output.setFrameBuffer(frame);
    output.writePixels(24);
  }
}

// The message lists the layers of the file when no color is found.
TEST_F(CliErrors, LayersOfTheFileAreListed) {
  const std::vector<std::string> names = {"paint.R", "paint.G", "paint.B", "wall.X",
                                          "wall.Y",  "wall.Z",  "id"};
  write_image(folder_ / "high.exr", names, random_image(names, 32, 24, 2));
  expect_error(fuse(), {"high.exr", "color: looked for", "the file has: paint, wall"});
}

TEST_F(CliErrors, ChannelsThatCannotBePassedThrough) {
  write_parts(folder_ / "high.exr");
  EXPECT_EQ(run(fuse({"--map", "color=beauty", "--dry-run"})).exit_status, 0);
  expect_error(fuse({"--map", "color=beauty", "--keep-layers", "--dry-run"}),
               {"high.exr", "'extra.B'", "16 x 24", "32 x 24"});
}

TEST_F(CliErrors, Models) {
  fs::create_directory(folder_ / "models");
  environment_["RAYMELD_MODELS"] = (folder_ / "models").string();
  const std::string model = read_file(tiny_model());
  write_file(folder_ / "models/x4-mine.safetensors", model);
  write_file(folder_ / "cut.safetensors", model.substr(0, model.size() - 100));
  remember_files();
  const auto with_model = [](const std::string& name) {
    return std::vector<std::string>{"fuse", "--lrhs",  "low.exr", "--hrls", "high.exr",
                                    "-o",   "out.exr", "--model", name};
  };
  expect_error(with_model("x3"), {"'x3'", "x4-mine"});
  expect_error(with_model("none.safetensors"), {"none.safetensors", "no such file"});
  expect_error(with_model("./models"), {"./models", "folder"});
  expect_error(with_model("cut.safetensors"), {"cut.safetensors"});
  expect_error(with_model("./low.exr"), {"./low.exr"});
  std::string other = model;
  other.replace(other.find("tiny-x4"), 7, "tiny-x\xff");
  write_file(folder_ / "cut.safetensors", other.replace(other.find("raymeld.model"), 13, "RAYMELD.MODEL"));
  expect_error(with_model("cut.safetensors"), {"cut.safetensors"});
}

TEST_F(CliErrors, Outputs) {
  const auto to = [](const std::string& output) {
    return std::vector<std::string>{"fuse",    "--lrhs",     "low.exr", "--hrls", "high.exr",
                                    "--model", tiny_model(), "-o",      output};
  };
  expect_error(to("none/out.exr"), {"none/out.exr", "no folder"});
  fs::create_directory(folder_ / "folder.exr");
  fs::create_symlink("/dev/full", folder_ / "device.exr");
  remember_files();
  expect_error(to("folder.exr"), {"'folder.exr'", "folder"});
  expect_error(to("device.exr"), {"device.exr", "regular file"});
  expect_error(to("./high.exr"), {"./high.exr", "same file"});
  expect_error(fuse({"--dump", "low.exr"}), {"low.exr", "folder"});
  expect_error(fuse({"--preview", "z.png", "--preview-before-after", "z.png"}), {"z.png", "same file"});
  expect_error(fuse({"--dump", "none/layers"}), {"none"});
  fs::create_hard_link(folder_ / "low.exr", folder_ / "low.png");
  fs::copy_file(tiny_model(), folder_ / "model.exr");
  remember_files();
  expect_error(fuse({"--preview", "low.png"}), {"low.png", "same file"});
  expect_error(
      {"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "--model", "./model.exr", "-o", "model.exr"},
      {"model.exr", "same file as the input"});
  expect_error({"degrade", "high.exr", "--scale", "4", "-o", "high.exr"}, {"high.exr", "same file"});
  expect_error({"compare", "low.exr", "low.exr", "--error-map", "low.png"}, {"low.png", "same file"});
}

TEST_F(CliErrors, OutputsOfAnotherKind) {
  expect_error({"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "--model", tiny_model(), "-o", "x.png"},
               {"--output", "'x.png' does not end in .exr", "--preview"});
  expect_error({"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "-o", "out"},
               {"'out' does not end in .exr"});
  for (const char* option : {"--preview", "--preview-before-after"})
    expect_error(fuse({option, "foo.jpg"}), {option, "'foo.jpg' does not end in .png"});
  expect_error({"degrade", "high.exr", "--scale", "4", "-o", "low.png"}, {"'low.png' does not end in .exr"});
  expect_error({"compare", "low.exr", "low.exr", "--error-map", "e.exr"}, {"'e.exr' does not end in .png"});
  EXPECT_EQ(run(fuse({"--preview", "UPPER.PNG"})).exit_status, 0);
}

// An error of any kind is also written to stdout with --json, once.
TEST_F(CliErrors, AreInJsonToo) {
  const auto error = [&](const std::vector<std::string>& arguments) {
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_status, 2);
    EXPECT_EQ(result.err.find("raymeld: error: "), 0u) << result.err;
    const auto json = nlohmann::json::parse(result.out);
    const std::string message = json.at("error");
    EXPECT_NE(result.err.find(message), std::string::npos) << result.err;
    return message;
  };
  EXPECT_NE(
      error({"fuse", "--lrhs", "none.exr", "--hrls", "high.exr", "-o", "out.exr", "--json"}).find("none.exr"),
      std::string::npos);
  EXPECT_NE(error(fuse({"--json", "--window", "9"})).find("--window"), std::string::npos);
  EXPECT_NE(error({"compare", "low.exr", "high.exr", "--json"}).find("sizes must be equal"),
            std::string::npos);
  const std::string sequence = error({"fuse", "--lrhs", "low.#.exr", "--hrls", "high.exr", "-o", "out.#.exr",
                                      "--model", tiny_model(), "--frames", "1", "--json"});
  EXPECT_EQ(sequence.find("1 frames: 0 fused, 1 failed (1)"), 0u) << sequence;
}

// The disk's message is repeated only once.
TEST_F(CliErrors, AFullDiskIsSaidOnce) {
  const ProcessResult result = run_process({"sh", "-c", "ulimit -f 0; exec \"$@\"", "sh", RAYMELD_PROGRAM,
                                            "compare", "low.exr", "low.exr", "--error-map", "map.png"},
                                           {.directory = folder_.path(), .environment = environment_});
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_EQ(result.err.find("cannot write"), result.err.rfind("cannot write")) << result.err;
  EXPECT_NE(result.err.find("cannot write 'map.png': File too large"), std::string::npos) << result.err;
}

// The limit counts blocks of 512 bytes: the preview fits, the image does not, and neither stays, but older
// files do. Only commands that use no device are given a limit on file sizes: newer drivers take memory
// through files.
TEST_F(CliErrors, FullDisk) {
  const std::string script = "ulimit -f 1; exec \"$@\"";
  expect_shell_error(script, {"degrade", "high.exr", "--scale", "2", "-o", "half.exr"},
                     {"raymeld: error: ", "'half.exr'", "File too large"});
  const std::vector<std::string> older = {"half.exr", "out.exr", "preview.png", "layers/lrhs.npy"};
  fs::create_directory(folder_ / "layers");
  for (const std::string& name : older) write_file(folder_ / name, "older");
  remember_files();
  expect_shell_error(script, {"degrade", "high.exr", "--scale", "2", "-o", "half.exr"}, {"File too large"});
  for (const char* report : {"--json", "--profile"})
    expect_shell_error("exec \"$@\" > /dev/full",
                       fuse({report, "--preview", "preview.png", "--dump", "layers"}),
                       {"standard output", "No space left"});
  for (const std::string& name : older) EXPECT_EQ(read_file(folder_ / name), "older");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "layers"), {}), 1);
  expect_shell_error("exec \"$@\" > /dev/full", {"compare", "low.exr", "low.exr", "--error-map", "e.png"},
                     {"standard output"});
  expect_shell_error("exec \"$@\" > /dev/full", {"graph", "--model", tiny_model(), "--size", "64x48"},
                     {"standard output"});
}

TEST_F(CliErrors, Devices) {
  expect_error(fuse({"--device", "99"}), {"99"});
  expect_error(fuse({"--device", "no such device"}), {"no such device"});
  environment_["VK_DRIVER_FILES"] = environment_["VK_ICD_FILENAMES"] = "/nonexistent.json";
  expect_error(fuse(), {"no Vulkan", "mesa-vulkan-drivers"});
  expect_error({"devices"}, {"no Vulkan"});
}

TEST_F(CliErrors, NoVulkanLoader) {
  fs::create_directory(folder_ / "lib");
  for (const char* name : {"lib/libvulkan.so.1", "lib/libvulkan.so"}) write_file(folder_ / name, "");
  environment_["LD_LIBRARY_PATH"] = (folder_ / "lib").string();
  remember_files();
  expect_error(fuse(), {"no Vulkan loader"});
  expect_error({"devices"}, {"no Vulkan loader"});
}

// The frame has many small tiles, so that it takes far longer than a signal.
TEST_F(CliErrors, InterruptedInTheMiddle) {
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 128, 128, 1));
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 512, 512, 2));
  std::vector<std::string> arguments =
      fuse({"--max-memory", "1", "--kernels", "direct", "--preview", "preview.png"});
  arguments.insert(arguments.begin(), RAYMELD_PROGRAM);
  for (int signal : {SIGINT, SIGTERM}) {
    check(run_process(arguments, {.directory = folder_.path(),
                                  .environment = environment_,
                                  .signal = signal,
                                  .signal_after = "fusing"}),
          {"cancelled"}, 130);
  }
}

}  // namespace
}  // namespace raymeld::test

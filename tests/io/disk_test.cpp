// Tests full disks, read-only folders and inputs that change, as a user meets them. The program gets a mount
// namespace of its own for disks of a few KiB and read-only mounts.
#include <unistd.h>

#include "cli_fixture.h"
#include "names_on_disk.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;

class DiskTest : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 32, 32, 1));
    write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 128, 128, 2));
    fs::create_directory(folder_ / "place");
  }

  static bool can_mount() {
    return run_process({"unshare", "-rm", "mount", "-t", "tmpfs", "none", "/mnt"}).exit_status == 0;
  }

  // Runs raymeld in a mount namespace after `mount`. Its stdout then lists the files in `place` and the first
  // bytes of out.exr there.
  ProcessResult run_mounted(const std::string& mount, const std::vector<std::string>& arguments) const {
    const std::string script = mount + R"( || exit 99
      "$@" || status=$?
      (cd place && find . -type f -not -path '*mesa*' -not -path '*lvp*' | sort; head -c 5 out.exr)
      exit ${status:-0})";
    std::vector<std::string> argv = {"unshare", "-rm", "sh", "-c", script, "sh", RAYMELD_PROGRAM};
    argv.insert(argv.end(), arguments.begin(), arguments.end());
    return run_process(argv, {.directory = folder_.path(), .environment = environment_});
  }

  void expect_full(const std::vector<std::string>& arguments, const std::string& named) const {
    const std::string mount = "mount -t tmpfs -o size=8k none place && printf older > place/out.exr";
    const ProcessResult result = run_mounted(mount, arguments);
    EXPECT_EQ(result.exit_status, 2) << result.err;
    EXPECT_NE(result.err.find("cannot write '" + named), std::string::npos) << result.err;
    EXPECT_NE(result.err.find("No space left on device"), std::string::npos) << result.err;
    EXPECT_EQ(result.out, "./out.exr\nolder");
  }

  static std::vector<std::string> fuse_to(const std::string& output,
                                          const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"fuse",    "--lrhs",     "low.exr", "--hrls", "high.exr",
                                          "--model", tiny_model(), "-o",      output};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
};

TEST_F(DiskTest, FullWhereOutputsGo) {
  if (!can_mount()) GTEST_SKIP() << "mount namespaces are not permitted here";
  write_image(folder_ / "other.exr", kColorNames, random_image(kColorNames, 128, 128, 3));
  const std::set<std::string> before = files();
  expect_full(fuse_to("place/out.exr"), "place/out.exr'");
  expect_full(fuse_to("out.exr", {"--preview", "place/p.png"}), "place/p.png'");
  expect_full(fuse_to("out.exr", {"--preview-before-after", "place/p.png"}), "place/p.png'");
  expect_full(fuse_to("out.exr", {"--preview", "p.png", "--dump", "place/layers"}), "place/layers/");
  expect_full({"degrade", "high.exr", "--scale", "2", "-o", "place/out.exr"}, "place/out.exr'");
  expect_full({"compare", "high.exr", "other.exr", "--error-map", "place/e.png"}, "place/e.png'");
  EXPECT_EQ(files(), before);
}

// A pipeline cache that cannot be written does not fail the frame. A driver that caches its kernels itself
// leaves little to write, but there is no room even for that.
TEST_F(DiskTest, FullWhereTheCacheGoes) {
  if (!can_mount()) GTEST_SKIP() << "mount namespaces are not permitted here";
  ASSERT_EQ(run(fuse_to("out.exr")).exit_status, 0);
  const std::string expected = read_file(folder_ / "out.exr");
  environment_["XDG_CACHE_HOME"] = (folder_ / "place").string();
  for (const std::string mount :
       {"mount -t tmpfs -o size=4k none place && head -c 4096 /dev/zero > place/mesa",
        "mount --bind place place && mount -o remount,ro,bind place"}) {
    fs::remove(folder_ / "out.exr");
    const ProcessResult result = run_mounted(mount, fuse_to("out.exr"));
    EXPECT_EQ(result.exit_status, 0) << result.err;
    EXPECT_EQ(result.out, "") << "left in the cache";
    EXPECT_EQ(read_file(folder_ / "out.exr"), expected);
  }
}

// A place that cannot be written is an error before the frame is computed.
TEST_F(DiskTest, ReadOnlyMounts) {
  if (!can_mount()) GTEST_SKIP() << "mount namespaces are not permitted here";
  write_file(folder_ / "place/out.exr", "older");
  const std::set<std::string> before = files();
  for (const auto& arguments :
       {fuse_to("place/out.exr"), fuse_to("out.exr", {"--preview", "place/p.png"}),
        fuse_to("out.exr", {"--dump", "place/layers"}), fuse_to("out.exr", {"--dump", "place"})}) {
    const ProcessResult result =
        run_mounted("mount --bind place place && mount -o remount,ro,bind place", arguments);
    EXPECT_EQ(result.exit_status, 2);
    EXPECT_NE(result.err.find("cannot write 'place"), std::string::npos) << result.err;
    EXPECT_NE(result.err.find("Read-only file system"), std::string::npos) << result.err;
    EXPECT_EQ(result.err.find("fusing"), std::string::npos) << result.err;
    EXPECT_EQ(result.out, "./out.exr\nolder");
  }
  EXPECT_EQ(files(), before);
}

// Root may write everywhere, so the program is run as another user.
TEST_F(DiskTest, FoldersOfOtherUsers) {
  const bool is_root = geteuid() == 0;
  const auto as_user = [&](std::vector<std::string> argv) {
    if (is_root) argv.insert(argv.begin(), {"setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"});
    return run_process(argv, {.directory = folder_.path(), .environment = environment_});
  };
  fs::permissions(folder_.path(), fs::perms(0755));
  if (as_user({RAYMELD_PROGRAM, "degrade", "high.exr", "--scale", "2", "-o", "/dev/null"}).exit_status != 2)
    GTEST_SKIP() << "another user cannot run the program";
  fs::permissions(folder_ / "place", fs::perms(0555));
  std::vector<std::string> arguments = fuse_to("place/out.exr");
  arguments.insert(arguments.begin(), RAYMELD_PROGRAM);
  const ProcessResult result = as_user(arguments);
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("folder 'place': Permission denied"), std::string::npos) << result.err;
  EXPECT_EQ(result.err.find("fusing"), std::string::npos) << result.err;
  EXPECT_TRUE(fs::is_empty(folder_ / "place"));
  fs::permissions(folder_ / "place", fs::perms(0755));
}

// The inputs may change while a frame is computed, as also the alpha channel has been read by then.
TEST_F(DiskTest, InputsMayChangeWhileFusing) {
  fs::copy_file(tiny_model(), folder_ / "m.safetensors");
  const std::vector<std::string> command = {"fuse",    "--lrhs",          "low.exr", "--hrls", "high.exr",
                                            "--model", "./m.safetensors", "-o",      "out.exr"};
  add_fault_layer();
  ASSERT_EQ(run(command).exit_status, 0);
  const std::string expected = read_file(folder_ / "out.exr");
  fs::remove(folder_ / "out.exr");
  const auto overwrite = [&] {
    for (const char* name : {"low.exr", "high.exr", "m.safetensors"})
      write_file(folder_ / name, "overwritten");
  };
  const ProcessResult result =
      run_held("RAYMELD_HOLD_SUBMIT", submits(), command, "fusing", {.then = overwrite});
  EXPECT_EQ(result.exit_status, 0) << result.err;
  EXPECT_EQ(read_file(folder_ / "out.exr"), expected);
}

// A power cut leaves only whole files: a file is on the disk before it has its name, and the name is there
// before the program ends.
TEST_F(DiskTest, WhatHasANameIsOnTheDisk) {
  ASSERT_EQ(run(fuse_to("out.exr")).exit_status, 0);  // caches the kernels, which need not reach the disk
  add_sync_log();
  ASSERT_EQ(run(fuse_to("place/out.exr", {"--preview", "p.png"})).exit_status, 0);
  const std::set<std::string> names = names_on_disk(sync_log());
  EXPECT_TRUE(names.contains("out.exr") && names.contains("p.png")) << sync_log();
}

}  // namespace
}  // namespace raymeld::test

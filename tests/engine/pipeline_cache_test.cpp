#include "engine/pipeline_cache.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <thread>

#include "gpu.h"
#include "platform/folders.h"
#include "sealed_cache.h"

namespace raymeld::test {
namespace {

class PipelineCacheTest : public GpuTest {
 protected:
  // Compiles one pipeline through a cache on disk.
  void compile(PipelineCache& cache) {
    Graph graph(Storage::kFloat32);
    channel_means(graph, "means", graph.input("in", {8, 8, 1}), graph.tensor("out", {1, 1, 1}));
    graph.plan();
    Program program(gpu(), graph, cache, 1);
  }

  // Returns the file that compiling and saving leaves behind.
  std::filesystem::path save_one() {
    PipelineCache cache(gpu(), folder_.path());
    EXPECT_FALSE(cache.loaded());
    compile(cache);
    EXPECT_TRUE(cache.save());
    return cache.file();
  }

  size_t files() const {
    return size_t(std::distance(std::filesystem::directory_iterator(folder_.path()), {}));
  }

  TemporaryDirectory folder_;
};

TEST_F(PipelineCacheTest, SavedAndLoaded) {
  const std::filesystem::path file = save_one();
  EXPECT_EQ(file.parent_path(), folder_.path());
  EXPECT_EQ(files(), 1u);  // no temporary file is left
  const std::string content = read_file(file);
  PipelineCache again(gpu(), folder_.path());
  EXPECT_TRUE(again.loaded());
  compile(again);
  EXPECT_TRUE(again.save());
  EXPECT_EQ(read_file(file).size(), content.size());
}

TEST_F(PipelineCacheTest, DamagedFilesAreIgnoredAndReplaced) {
  const std::filesystem::path file = save_one();
  const std::string sound = read_file(file);
  constexpr size_t kHeaderBytes = 24;
  ASSERT_GE(sound.size(), kHeaderBytes + 32);  // Vulkan's own header takes 32 bytes
  const auto with = [&](size_t at, char flip) {
    std::string damaged = sound;
    damaged[at] = char(damaged[at] ^ flip);
    return damaged;
  };
  const std::string damaged[] = {
      "",
      "short",
      sound.substr(0, kHeaderBytes),
      sound.substr(0, sound.size() - 1),
      sound + "x",
      with(0, 1),                 // raymeld's own mark
      with(8, 1),                 // the size
      with(16, 1),                // the checksum
      with(kHeaderBytes + 8, 1),  // Vulkan's header: another vendor
      with(sound.size() - 1, 0x40),
      std::string(5000, '\xff'),
  };
  for (const std::string& content : damaged) {
    SCOPED_TRACE(content.size());
    write_file(file, content);
    PipelineCache cache(gpu(), folder_.path());
    EXPECT_FALSE(cache.loaded());
    compile(cache);
    EXPECT_TRUE(cache.save());
    EXPECT_TRUE(PipelineCache(gpu(), folder_.path()).loaded());
  }
}

// The foreign data is sealed as this device's would be.
TEST_F(PipelineCacheTest, ForeignCachesAreIgnored) {
  const std::filesystem::path file = PipelineCache(gpu(), folder_.path()).file();
  VkPhysicalDeviceProperties properties = gpu().properties();
  const auto loaded_from = [&](const std::string& content) {
    write_file(file, content);
    return PipelineCache(gpu(), folder_.path()).loaded();
  };
  EXPECT_TRUE(loaded_from(sealed_cache(cache_header(properties))));
  EXPECT_FALSE(loaded_from(sealed_cache("")));
  EXPECT_FALSE(loaded_from(sealed_cache(cache_header(properties).substr(0, 31))));
  for (uint32_t* part : {&properties.vendorID, &properties.deviceID}) {
    ++*part;
    EXPECT_FALSE(loaded_from(sealed_cache(cache_header(properties))));
    --*part;
  }
  properties.pipelineCacheUUID[15] ^= 1;
  const std::string foreign = sealed_cache(cache_header(properties));
  EXPECT_FALSE(loaded_from(foreign));
  properties.pipelineCacheUUID[15] ^= 1;
  EXPECT_FALSE(loaded_from(foreign.substr(0, 24) + cache_header(properties)));  // the other data's checksum
}

// The file is sparse and takes no room on the disk. No memory is allocated for it either.
TEST_F(PipelineCacheTest, FilesOfATerabyteAreIgnored) {
  const std::filesystem::path file = PipelineCache(gpu(), folder_.path()).file();
  constexpr uint64_t kTerabyte = 1ull << 40;
  write_file(file, "RmCache1" + bytes_of(kTerabyte - 24) + bytes_of(uint64_t{0}));
  std::filesystem::resize_file(file, kTerabyte);
  EXPECT_FALSE(PipelineCache(gpu(), folder_.path()).loaded());
}

TEST_F(PipelineCacheTest, TheLastOfTwoWritersWins) {
  PipelineCache first(gpu(), folder_.path()), second(gpu(), folder_.path());
  compile(first);
  compile(second);
  EXPECT_TRUE(first.save());
  EXPECT_TRUE(second.save());
  EXPECT_EQ(files(), 1u);
  EXPECT_TRUE(PipelineCache(gpu(), folder_.path()).loaded());
}

TEST_F(PipelineCacheTest, WritersAtOnceLeaveAWholeFile) {
  PipelineCache first(gpu(), folder_.path()), second(gpu(), folder_.path());
  compile(first);
  compile(second);
  const auto save_often = [](const PipelineCache& cache) {
    for (int i = 0; i < 200; ++i) cache.save();
  };
  std::thread other([&] { save_often(second); });
  save_often(first);
  other.join();
  EXPECT_TRUE(PipelineCache(gpu(), folder_.path()).loaded());
  EXPECT_EQ(files(), 1u);
}

TEST_F(PipelineCacheTest, NowhereToWriteIsNoError) {
  PipelineCache none(gpu(), {});
  compile(none);
  EXPECT_FALSE(none.save());
  write_file(folder_ / "file", "not a folder");
  PipelineCache blocked(gpu(), folder_ / "file");
  compile(blocked);
  EXPECT_FALSE(blocked.save());
  EXPECT_EQ(read_file(folder_ / "file"), "not a folder");
}

TEST(PipelineCacheFolder, FollowsXdg) {
  setenv("XDG_CACHE_HOME", "/x/cache", 1);
  setenv("HOME", "/x/home", 1);
  EXPECT_EQ(default_cache_folder(), "/x/cache/raymeld");
  setenv("XDG_CACHE_HOME", "relative", 1);  // a relative path is invalid by the XDG specification
  EXPECT_EQ(default_cache_folder(), "/x/home/.cache/raymeld");
  unsetenv("XDG_CACHE_HOME");
  EXPECT_EQ(default_cache_folder(), "/x/home/.cache/raymeld");
  unsetenv("HOME");
  EXPECT_EQ(default_cache_folder(), "");
}

}  // namespace
}  // namespace raymeld::test

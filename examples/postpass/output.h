// Images as files: RGBA floats, sRGB, of which RGB is written.
#pragma once

#include <cstdio>
#include <filesystem>
#include <memory>
#include <vector>
#include <vulkan/vulkan.hpp>

namespace postpass {

// Whole, or not at all.
void write_png(const std::filesystem::path& path, const float* image, vk::Extent2D size);

// YUV4MPEG2, 4:4:4, BT.709, of frames of one size. It has its name once it is whole: until close(), ".part"
// follows.
class Y4mFile {
 public:
  Y4mFile(const std::filesystem::path& path, vk::Extent2D size, double frames_per_second);
  ~Y4mFile();
  Y4mFile(const Y4mFile&) = delete;
  Y4mFile& operator=(const Y4mFile&) = delete;

  void write(const float* image, vk::Extent2D size);  // throws if it is of another size
  void close();

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::unique_ptr<std::FILE, Close> file_;
  std::filesystem::path path_, partial_;
  vk::Extent2D size_;
  std::vector<unsigned char> planes_;
};

}  // namespace postpass

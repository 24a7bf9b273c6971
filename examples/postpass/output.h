// Writes images to files. Pixels are RGBA floats, sRGB, of which RGB is written.
#pragma once

#include <cstdio>
#include <filesystem>
#include <memory>
#include <vector>
#include <vulkan/vulkan.hpp>

namespace postpass {

// Writes a whole file or none.
void write_png(const std::filesystem::path& path, const float* image, vk::Extent2D size);

// Writes frames of one size as YUV4MPEG2, 4:4:4, BT.709. The file's name ends in ".part" until close().
class Y4mFile {
 public:
  Y4mFile(const std::filesystem::path& path, vk::Extent2D size, double frames_per_second);
  ~Y4mFile();
  Y4mFile(const Y4mFile&) = delete;
  Y4mFile& operator=(const Y4mFile&) = delete;

  void write(const float* image, vk::Extent2D size);  // throws if the size is another one
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

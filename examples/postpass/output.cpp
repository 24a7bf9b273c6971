#include "output.h"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace postpass {
namespace {

unsigned char to_byte(double value) {
  return static_cast<unsigned char>(std::lround(std::clamp(value, 0.0, 255.0)));
}

}  // namespace

void write_png(const std::filesystem::path& path, const float* image, vk::Extent2D size) {
  std::vector<unsigned char> bytes;
  for (size_t i = 0; i < size_t{size.width} * size.height; ++i)
    for (size_t c = 0; c < 3; ++c) bytes.push_back(to_byte(255 * image[4 * i + c]));
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  header.width = size.width;
  header.height = size.height;
  header.format = PNG_FORMAT_RGB;
  const std::filesystem::path partial = path.string() + ".part";
  if (!png_image_write_to_file(&header, partial.c_str(), 0, bytes.data(), 0, nullptr)) {
    std::filesystem::remove(partial);
    throw std::runtime_error("writing " + path.string() + ": " + header.message);
  }
  std::filesystem::rename(partial, path);
}

Y4mFile::Y4mFile(const std::filesystem::path& path, vk::Extent2D size, double frames_per_second)
    : path_(path), partial_(path.string() + ".part"), size_(size) {
  file_.reset(std::fopen(partial_.c_str(), "wb"));
  if (!file_) throw std::runtime_error("cannot write " + path.string());
  std::fprintf(file_.get(), "YUV4MPEG2 W%u H%u F%ld:1000 Ip A1:1 C444\n", size.width, size.height,
               std::lround(1000 * frames_per_second));
}

Y4mFile::~Y4mFile() {
  std::error_code none;
  if (file_) std::filesystem::remove(partial_, none);
}

void Y4mFile::close() {
  if (std::fclose(file_.release()) != 0) throw std::runtime_error("writing " + path_.string() + " failed");
  std::filesystem::rename(partial_, path_);
}

void Y4mFile::write(const float* image, vk::Extent2D size) {
  if (size != size_) throw std::runtime_error("the frames of " + path_.string() + " are to have one size");
  const size_t pixels = size_t{size_.width} * size_.height;
  planes_.resize(3 * pixels);
  for (size_t i = 0; i < pixels; ++i) {
    const double r = image[4 * i], g = image[4 * i + 1], b = image[4 * i + 2];
    const double y = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    planes_[i] = to_byte(16 + 219 * y);
    planes_[pixels + i] = to_byte(128 + 224 * (b - y) / 1.8556);
    planes_[2 * pixels + i] = to_byte(128 + 224 * (r - y) / 1.5748);
  }
  if (std::fputs("FRAME\n", file_.get()) < 0 ||
      std::fwrite(planes_.data(), planes_.size(), 1, file_.get()) != 1)
    throw std::runtime_error("writing " + path_.string() + " failed");
}

}  // namespace postpass

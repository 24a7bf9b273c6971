// Fuses a frame of the model in argv[1] through the installed package. Exits with 0 if the image is finite
// and not all zero.
#include <cmath>
#include <cstdio>
#include <exception>
#include <raymeld/raymeld.hpp>
#include <vector>

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  try {
    const uint32_t height = 5, width = 7;
    const raymeld::Context context;
    const raymeld::SharedModel model(argv[1]);
    raymeld::Fusion fusion(context, model, {.height = height, .width = width});
    const size_t s = fusion.info().scale, layers = fusion.layers().size();
    std::vector<float> lrhs(3 * height * width, 0.5f), hrls(3 * layers * s * s * height * width, 0.25f);
    std::vector<float> fused(3 * s * s * height * width, -1.0f);
    fusion.fuse(lrhs.data(), hrls.data(), fused.data());
    double sum = 0;
    for (float value : fused) {
      if (!std::isfinite(value) || value < 0) return 1;
      sum += value;
    }
    std::printf("mean %g\n", sum / static_cast<double>(fused.size()));
    return sum > 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}

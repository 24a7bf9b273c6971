// Computes one level of joint_filter.py's filter, and its gradient, at the speed that training needs.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

namespace {

// A pixel has three colors and, as its last channel, a certainty.
constexpr int kColors = 3, kChannels = 4, kTaps = 9;
constexpr float kBinomial[3] = {0.25f, 0.5f, 0.25f};

// Holds planes with `pad` replicated pixels on each side.
struct Padded {
  int h, w, pad, stride, plane;
  std::vector<float> values;

  Padded(int count, int height, int width, int pad_pixels)
      : h(height),
        w(width),
        pad(pad_pixels),
        stride(w + 2 * pad),
        plane(stride * (h + 2 * pad)),
        values(static_cast<size_t>(plane) * count) {}

  // Returns the first pixel of row y in plane c.
  float* row(int c, int y) { return values.data() + c * plane + (y + pad) * stride + pad; }

  void fill(int c, const float* from) {
    for (int y = -pad; y < h + pad; ++y) {
      const float* source = from + std::clamp(y, 0, h - 1) * w;
      float* to = row(c, y);
      std::fill(to - pad, to, source[0]);
      std::memcpy(to, source, w * sizeof(float));
      std::fill(to + w, to + w + pad, source[w - 1]);
    }
  }

  // Adds the planes, and their padding to the pixels that it replicates; this is the transpose of fill().
  void fold(int c, float* to) {
    for (int y = -pad; y < h + pad; ++y) {
      const float* from = row(c, y);
      float* target = to + std::clamp(y, 0, h - 1) * w;
      for (int i = 0; i < w; ++i) target[i] += from[i];
      for (int i = 1; i <= pad; ++i) target[0] += from[-i], target[w - 1] += from[w - 1 + i];
    }
  }
};

// Holds the inputs of a level, the four channels of x and the guides, padded by `step` pixels.
struct Level {
  int h, w, step, guides;
  Padded planes;

  Level(const float* x, const float* guide, int guide_count, int height, int width, int step_pixels)
      : h(height),
        w(width),
        step(step_pixels),
        guides(guide_count),
        planes(kChannels + guide_count, height, width, step_pixels) {
    for (int c = 0; c < kChannels; ++c) planes.fill(c, x + c * h * w);
    for (int g = 0; g < guides; ++g) planes.fill(kChannels + g, guide + g * h * w);
  }

  int offset(int tap) const { return step * ((tap / 3 - 1) * planes.stride + tap % 3 - 1); }

  // Computes the weights of a row's pixels for one tap.
  void weigh(int y, int tap, float* weight) {
    std::fill(weight, weight + w, 0.f);
    for (int c = kChannels; c < kChannels + guides; ++c) {
      const float *a = planes.row(c, y), *b = a + offset(tap);
      for (int i = 0; i < w; ++i) weight[i] += (a[i] - b[i]) * (a[i] - b[i]);
    }
    const float kernel = kBinomial[tap / 3] * kBinomial[tap % 3];
    for (int i = 0; i < w; ++i) weight[i] = kernel * std::exp(-weight[i]);
  }
};

void forward(Level& level, float* out) {
  const int h = level.h, w = level.w;
  std::vector<float> weight(w), total(w);
  std::memset(out, 0, sizeof(float) * kChannels * h * w);
  for (int y = 0; y < h; ++y) {
    float* certainty = out + (kColors * h + y) * w;
    std::fill(total.begin(), total.end(), 0.f);
    for (int tap = 0; tap < kTaps; ++tap) {
      level.weigh(y, tap, weight.data());
      for (int i = 0; i < w; ++i) total[i] += weight[i];
      const float* counts = level.planes.row(kColors, y) + level.offset(tap);
      for (int i = 0; i < w; ++i) weight[i] *= counts[i];
      for (int i = 0; i < w; ++i) certainty[i] += weight[i];
      for (int c = 0; c < kColors; ++c) {
        const float* b = level.planes.row(c, y) + level.offset(tap);
        float* sum = out + (c * h + y) * w;
        for (int i = 0; i < w; ++i) sum[i] += weight[i] * b[i];
      }
    }
    for (int c = 0; c < kColors; ++c) {
      for (int i = 0; i < w; ++i) out[(c * h + y) * w + i] /= certainty[i];
    }
    for (int i = 0; i < w; ++i) certainty[i] /= total[i];
  }
}

// Adds to the gradients; `out` is the output of forward(). Pixel j has the weight w for pixel i and the
// certainty c. W is the sum of w, and C is the sum of w c. A level is y = (sum of w c x) / C and C / W.
void backward(Level& level, const float* out, const float* grad_out, float* grad_x, float* grad_guides) {
  const int h = level.h, w = level.w, plane = h * w;
  Padded grads(kChannels + level.guides, h, w, level.step);
  std::vector<float> weights(kTaps * w), total(w), per_color(kColors * w), per_count(w), of_weight(w);
  for (int y = 0; y < h; ++y) {
    const float *result = out + y * w, *grad = grad_out + y * w;
    std::fill(total.begin(), total.end(), 0.f);
    for (int tap = 0; tap < kTaps; ++tap) {
      float* weight = weights.data() + tap * w;
      level.weigh(y, tap, weight);
      for (int i = 0; i < w; ++i) total[i] += weight[i];
    }
    for (int i = 0; i < w; ++i) {
      const float sum = result[kColors * plane + i] * total[i];
      for (int c = 0; c < kColors; ++c) per_color[c * w + i] = grad[c * plane + i] / sum;
      per_count[i] = grad[kColors * plane + i] / total[i];
    }
    for (int tap = 0; tap < kTaps; ++tap) {
      const float* weight = weights.data() + tap * w;
      const int offset = level.offset(tap);
      const float* counts = level.planes.row(kColors, y) + offset;
      float* grad_counts = grads.row(kColors, y) + offset;
      // The derivative by w c comes first, as w and c share it.
      for (int i = 0; i < w; ++i) of_weight[i] = per_count[i];
      for (int c = 0; c < kColors; ++c) {
        const float *x = level.planes.row(c, y) + offset, *by = per_color.data() + c * w;
        float* to = grads.row(c, y) + offset;
        for (int i = 0; i < w; ++i) of_weight[i] += by[i] * (x[i] - result[c * plane + i]);
        for (int i = 0; i < w; ++i) to[i] += by[i] * weight[i] * counts[i];
      }
      for (int i = 0; i < w; ++i) grad_counts[i] += weight[i] * of_weight[i];
      for (int i = 0; i < w; ++i)
        of_weight[i] = of_weight[i] * counts[i] - per_count[i] * result[kColors * plane + i];
      for (int i = 0; i < w; ++i) of_weight[i] *= -2 * weight[i];
      for (int c = kChannels; c < kChannels + level.guides; ++c) {
        const float *a = level.planes.row(c, y), *b = a + offset;
        float *to_a = grads.row(c, y), *to_b = to_a + offset;
        for (int i = 0; i < w; ++i) total[i] = of_weight[i] * (a[i] - b[i]);
        for (int i = 0; i < w; ++i) to_a[i] += total[i];
        for (int i = 0; i < w; ++i) to_b[i] -= total[i];
      }
    }
  }
  for (int c = 0; c < kChannels; ++c) grads.fold(c, grad_x + c * plane);
  for (int g = 0; g < level.guides; ++g) grads.fold(kChannels + g, grad_guides + g * plane);
}

}  // namespace

// Filters x [n, 4, h, w] by guides [n, guide_count, h, w] into out [n, 4, h, w].
extern "C" void level_forward(const float* x, const float* guides, int n, int guide_count, int h, int w,
                              int step, float* out) {
  const size_t image = static_cast<size_t>(kChannels) * h * w,
               guide = static_cast<size_t>(guide_count) * h * w;
  for (int i = 0; i < n; ++i) {
    Level level(x + i * image, guides + i * guide, guide_count, h, w, step);
    forward(level, out + i * image);
  }
}

// Adds to `grad_x` and `grad_guides`, which have the shapes of x and guides.
extern "C" void level_backward(const float* x, const float* guides, const float* out, const float* grad_out,
                               int n, int guide_count, int h, int w, int step, float* grad_x,
                               float* grad_guides) {
  const size_t image = static_cast<size_t>(kChannels) * h * w,
               guide = static_cast<size_t>(guide_count) * h * w;
  for (int i = 0; i < n; ++i) {
    Level level(x + i * image, guides + i * guide, guide_count, h, w, step);
    backward(level, out + i * image, grad_out + i * image, grad_x + i * image, grad_guides + i * guide);
  }
}

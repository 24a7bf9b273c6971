// The joint filter of joint_filter.py at the speed of a training step.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

namespace {

// Colors, and the certainty of each pixel.
constexpr int kColors = 3, kChannels = 4;

// A plane with `pad` replicated pixels on each side of it.
void pad_plane(const float* from, int h, int w, int pad, float* to) {
  const int stride = w + 2 * pad;
  for (int y = 0; y < h + 2 * pad; ++y) {
    const int source = y < pad ? 0 : y - pad >= h ? h - 1 : y - pad;
    const float* row = from + source * w;
    float* out = to + y * stride;
    for (int i = 0; i < pad; ++i) out[i] = row[0], out[pad + w + i] = row[w - 1];
    std::memcpy(out + pad, row, w * sizeof(float));
  }
}

void level(const float* x, const float* guides, int guide_count, int h, int w, int step, float* out) {
  const int stride = w + 2 * step, plane = stride * (h + 2 * step), count = kChannels + guide_count;
  std::vector<float> padded(static_cast<size_t>(plane) * count), weight(w), total(w);
  for (int c = 0; c < count; ++c) {
    const float* from = c < kChannels ? x + c * h * w : guides + (c - kChannels) * h * w;
    pad_plane(from, h, w, step, padded.data() + c * plane);
  }
  std::memset(out, 0, sizeof(float) * kChannels * h * w);
  float* certainty = out + kColors * h * w;
  for (int y = 0; y < h; ++y) {
    std::fill(total.begin(), total.end(), 0.f);
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const int here = (y + step) * stride + step, there = here + step * (dy * stride + dx);
        std::fill(weight.begin(), weight.end(), 0.f);
        for (int c = kChannels; c < count; ++c) {
          const float* a = padded.data() + c * plane + here;
          const float* b = padded.data() + c * plane + there;
          for (int i = 0; i < w; ++i) weight[i] += (a[i] - b[i]) * (a[i] - b[i]);
        }
        const float tap = (dy ? 0.25f : 0.5f) * (dx ? 0.25f : 0.5f);
        for (int i = 0; i < w; ++i) weight[i] = tap * std::exp(-weight[i]);
        for (int i = 0; i < w; ++i) total[i] += weight[i];
        const float* counts = padded.data() + kColors * plane + there;
        for (int i = 0; i < w; ++i) weight[i] *= counts[i];
        for (int i = 0; i < w; ++i) certainty[y * w + i] += weight[i];
        for (int c = 0; c < kColors; ++c) {
          const float* b = padded.data() + c * plane + there;
          float* sum = out + (c * h + y) * w;
          for (int i = 0; i < w; ++i) sum[i] += weight[i] * b[i];
        }
      }
    }
    for (int c = 0; c < kColors; ++c) {
      for (int i = 0; i < w; ++i) out[(c * h + y) * w + i] /= certainty[y * w + i];
    }
    for (int i = 0; i < w; ++i) certainty[y * w + i] /= total[i];
  }
}

}  // namespace

// x [n, 4, h, w], guides [n, guide_count, h, w] -> out [levels, n, 4, h, w].
extern "C" void joint_filter(const float* x, const float* guides, int n, int guide_count, int h, int w,
                             int levels, float* out) {
  const size_t image = static_cast<size_t>(kChannels) * h * w;
  for (int i = 0; i < n; ++i) {
    const float* from = x + i * image;
    for (int l = 0; l < levels; ++l) {
      float* to = out + (static_cast<size_t>(l) * n + i) * image;
      level(from, guides + static_cast<size_t>(i) * guide_count * h * w, guide_count, h, w, 1 << l, to);
      from = to;
    }
  }
}

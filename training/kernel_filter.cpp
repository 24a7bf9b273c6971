// Computes kernel_filter.py's filter, and its gradient by the logits, at the speed that training needs.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

namespace {

// Holds an image with `pad` replicated pixels on each side.
struct Padded {
  int h, w, pad, stride;
  std::vector<float> values;

  Padded(const float* image, int channels, int height, int width, int pad_pixels)
      : h(height),
        w(width),
        pad(pad_pixels),
        stride(w + 2 * pad),
        values(static_cast<size_t>(channels) * stride * (h + 2 * pad)) {
    for (int c = 0; c < channels; ++c) {
      for (int y = -pad; y < h + pad; ++y) {
        const float* from = image + (static_cast<size_t>(c) * h + std::clamp(y, 0, h - 1)) * w;
        float* to = row(c, y);
        std::fill(to - pad, to, from[0]);
        std::memcpy(to, from, w * sizeof(float));
        std::fill(to + w, to + w + pad, from[w - 1]);
      }
    }
  }

  // Returns the first pixel of row y in channel c.
  float* row(int c, int y) {
    return values.data() + (static_cast<size_t>(c) * (h + 2 * pad) + y + pad) * stride + pad;
  }
};

struct Sizes {
  int n, channels, h, w, side;

  int taps() const { return side * side; }
  size_t plane() const { return static_cast<size_t>(h) * w; }
};

// Computes the weights of a row's pixels, tap by tap.
class Softmax {
 public:
  explicit Softmax(const Sizes& sizes) : s_(sizes), weights_(s_.taps() * s_.w), largest_(s_.w), sum_(s_.w) {}

  const float* of(int tap) const { return weights_.data() + tap * s_.w; }

  void compute(const float* logits, int y) {
    std::fill(sum_.begin(), sum_.end(), 0.f);
    const auto row = [&](int tap) { return logits + tap * s_.plane() + static_cast<size_t>(y) * s_.w; };
    std::copy_n(row(0), s_.w, largest_.begin());
    for (int tap = 1; tap < s_.taps(); ++tap) {
      const float* from = row(tap);
      for (int i = 0; i < s_.w; ++i) largest_[i] = std::max(largest_[i], from[i]);
    }
    for (int tap = 0; tap < s_.taps(); ++tap) {
      const float* from = row(tap);
      float* to = weights_.data() + tap * s_.w;
      for (int i = 0; i < s_.w; ++i) to[i] = std::exp(from[i] - largest_[i]);
      for (int i = 0; i < s_.w; ++i) sum_[i] += to[i];
    }
    for (int tap = 0; tap < s_.taps(); ++tap) {
      float* to = weights_.data() + tap * s_.w;
      for (int i = 0; i < s_.w; ++i) to[i] /= sum_[i];
    }
  }

 private:
  const Sizes& s_;
  std::vector<float> weights_, largest_, sum_;
};

// Calls visit(image's number, y, softmax, shifted), where shifted(c, tap) is row y of channel c as the tap
// sees it.
template <typename Visit>
void for_each_row(const Sizes& s, const float* x, const float* logits, const Visit& visit) {
  Softmax softmax(s);
  for (int i = 0; i < s.n; ++i) {
    Padded image(x + i * s.channels * s.plane(), s.channels, s.h, s.w, s.side / 2);
    const auto row_of = [&](int y) {
      return [&, y](int c, int tap) {
        return image.row(c, y + tap / s.side - s.side / 2) + tap % s.side - s.side / 2;
      };
    };
    for (int y = 0; y < s.h; ++y) {
      softmax.compute(logits + i * s.taps() * s.plane(), y);
      visit(i, y, softmax, row_of(y));
    }
  }
}

}  // namespace

// Filters x [n, channels, h, w] by logits [n, side^2, h, w] into out [n, channels, h, w].
extern "C" void kernel_forward(const float* x, const float* logits, int n, int channels, int h, int w,
                               int side, float* out) {
  const Sizes s{n, channels, h, w, side};
  std::memset(out, 0, sizeof(float) * n * channels * s.plane());
  for_each_row(s, x, logits, [&](int i, int y, const Softmax& softmax, const auto& shifted) {
    for (int tap = 0; tap < s.taps(); ++tap) {
      const float* weight = softmax.of(tap);
      for (int c = 0; c < channels; ++c) {
        const float* from = shifted(c, tap);
        float* to = out + (static_cast<size_t>(i * channels + c) * h + y) * w;
        for (int k = 0; k < w; ++k) to[k] += weight[k] * from[k];
      }
    }
  });
}

// Writes the gradient by the logits: weight * sum over channels of grad_out * (x - out).
extern "C" void kernel_backward(const float* x, const float* logits, const float* out, const float* grad_out,
                                int n, int channels, int h, int w, int side, float* grad_logits) {
  const Sizes s{n, channels, h, w, side};
  for_each_row(s, x, logits, [&](int i, int y, const Softmax& softmax, const auto& shifted) {
    for (int tap = 0; tap < s.taps(); ++tap) {
      const float* weight = softmax.of(tap);
      float* to = grad_logits + (static_cast<size_t>(i * s.taps() + tap) * h + y) * w;
      std::fill(to, to + w, 0.f);
      for (int c = 0; c < channels; ++c) {
        const size_t at = (static_cast<size_t>(i * channels + c) * h + y) * w;
        const float *from = shifted(c, tap), *result = out + at, *grad = grad_out + at;
        for (int k = 0; k < w; ++k) to[k] += grad[k] * (from[k] - result[k]);
      }
      for (int k = 0; k < w; ++k) to[k] *= weight[k];
    }
  });
}

// Writes out [n, side^2, h, w], the squared distance over channels of each pixel of x and of those around it.
extern "C" void squared_distances(const float* x, int n, int channels, int h, int w, int side, float* out) {
  const Sizes s{n, channels, h, w, side};
  std::memset(out, 0, sizeof(float) * n * s.taps() * s.plane());
  for (int i = 0; i < n; ++i) {
    Padded image(x + i * channels * s.plane(), channels, h, w, side / 2);
    for (int tap = 0; tap < s.taps(); ++tap) {
      for (int y = 0; y < h; ++y) {
        float* to = out + (static_cast<size_t>(i * s.taps() + tap) * h + y) * w;
        for (int c = 0; c < channels; ++c) {
          const float* own = image.row(c, y);
          const float* other = image.row(c, y + tap / side - side / 2) + tap % side - side / 2;
          for (int k = 0; k < w; ++k) to[k] += (own[k] - other[k]) * (own[k] - other[k]);
        }
      }
    }
  }
}

// Computes nfor.py's collaborative regression.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace {

// A pixel is seen as the differences of six features and of its position, and 1, followed by its three
// colors.
constexpr int kFeatures = 6, kUnknowns = kFeatures + 3, kColors = 3, kConstant = kUnknowns - 1;
constexpr int kColumns = 16;  // a vector; the last columns are 0

using Row = std::array<float, kColumns>;
using Equations =
    std::array<Row, kUnknowns>;  // the normal equations, and in the columns of colors their right sides

// Solves symmetric, positive definite equations by Cholesky's decomposition. The solutions are then in the
// columns of colors.
void solve(Equations& a) {
  for (int i = 0; i < kUnknowns; ++i) {
    for (int j = 0; j <= i; ++j) {
      double sum = a[i][j];
      for (int k = 0; k < j; ++k) sum -= double{a[i][k]} * a[j][k];
      a[i][j] = static_cast<float>(i == j ? std::sqrt(std::max(sum, 1e-12)) : sum / a[j][j]);
    }
  }
  for (int c = kUnknowns; c < kUnknowns + kColors; ++c) {
    for (int i = 0; i < kUnknowns; ++i) {
      for (int k = 0; k < i; ++k) a[i][c] -= a[i][k] * a[k][c];
      a[i][c] /= a[i][i];
    }
    for (int i = kUnknowns; i-- > 0;) {
      for (int k = i + 1; k < kUnknowns; ++k) a[i][c] -= a[k][i] * a[k][c];
      a[i][c] /= a[i][i];
    }
  }
}

struct Images {
  int h, w, radius;
  const float *x, *features, *weights;

  // Calls visit(index of a pixel, its weight, the pixel as it is seen from pixel (v, u)) for each pixel of a
  // window.
  template <typename Visit>
  void for_each(int v, int u, const Visit& visit) const {
    const int side = 2 * radius + 1, here = v * w + u;
    const size_t pixels = static_cast<size_t>(h) * w;
    Row seen{};
    seen[kConstant] = 1;
    for (int dy = std::max(-radius, -v); dy <= std::min(radius, h - 1 - v); ++dy) {
      for (int dx = std::max(-radius, -u); dx <= std::min(radius, w - 1 - u); ++dx) {
        const int there = here + dy * w + dx;
        for (int i = 0; i < kFeatures; ++i)
          seen[i] = features[there * kFeatures + i] - features[here * kFeatures + i];
        seen[kFeatures] = static_cast<float>(dy) / radius;
        seen[kFeatures + 1] = static_cast<float>(dx) / radius;
        for (int c = 0; c < kColors; ++c) seen[kUnknowns + c] = x[there * kColors + c];
        visit(there, weights[((dy + radius) * side + dx + radius) * pixels + here], seen);
      }
    }
  }
};

}  // namespace

// Fits the colors around each pixel by a constant and the differences of features and of position, weighted.
// A pixel's result is the mean of what all fits around it say of it, by the same weights.
// The shapes are: x and out [h][w][3], features [h][w][6], weights [(2 radius + 1)^2][h][w] row by row of the
// window. `ridge`, times the sum of a pixel's weights, is added to the diagonal, but not for the constant.
extern "C" void regress(const float* x, const float* features, const float* weights, int h, int w, int radius,
                        float ridge, float* out) {
  const Images images{h, w, radius, x, features, weights};
  const size_t pixels = static_cast<size_t>(h) * w;
  std::vector<std::array<float, kColors + 1>> sums(pixels);  // the last is that of the weights
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      Equations equations{};
      images.for_each(v, u, [&](int, float weight, const Row& seen) {
        for (int i = 0; i < kUnknowns; ++i)
          for (int j = 0; j < kColumns; ++j) equations[i][j] += weight * seen[i] * seen[j];
      });
      for (int i = 0; i < kConstant; ++i) equations[i][i] += ridge * equations[kConstant][kConstant];
      solve(equations);
      images.for_each(v, u, [&](int there, float weight, const Row& seen) {
        sums[there][kColors] += weight;
        for (int i = 0; i < kUnknowns; ++i)
          for (int c = 0; c < kColors; ++c) sums[there][c] += weight * seen[i] * equations[i][kUnknowns + c];
      });
    }
  }
  for (size_t i = 0; i < pixels; ++i)
    for (int c = 0; c < kColors; ++c) out[i * kColors + c] = sums[i][c] / sums[i][kColors];
}

#include "reference/winograd.h"

#include <algorithm>
#include <cmath>

namespace raymeld::reference {
namespace {

template <typename Number>
using Matrix = std::vector<std::vector<Number>>;

template <typename Number>
struct Transforms {
  Matrix<Number> input, weight, output;  // B^T, G, A^T
};

template <typename Number>
Transforms<Number> transforms(int m) {
  if (m == 1) return {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{1, 1, 1}}};
  if (m == 2) {
    return {{{1, 0, -1, 0}, {0, 1, 1, 0}, {0, -1, 1, 0}, {0, 1, 0, -1}},
            {{1, 0, 0}, {.5, .5, .5}, {.5, -.5, .5}, {0, 0, 1}},
            {{1, 1, 1, 0}, {0, 1, -1, -1}}};
  }
  const auto over = [](double a, double b) { return Number(a / b); };
  return {{{4, 0, -5, 0, 1, 0},
           {0, -4, -4, 1, 1, 0},
           {0, 4, -4, -1, 1, 0},
           {0, -2, -1, 2, 1, 0},
           {0, 2, -1, -2, 1, 0},
           {0, 4, 0, -5, 0, 1}},
          {{over(1, 4), 0, 0},
           {over(-1, 6), over(-1, 6), over(-1, 6)},
           {over(-1, 6), over(1, 6), over(-1, 6)},
           {over(1, 24), over(1, 12), over(1, 6)},
           {over(1, 24), over(-1, 12), over(1, 6)},
           {0, 0, 1}},
          {{1, 1, 1, 1, 1, 0}, {0, 1, -1, 2, -2, 0}, {0, 1, 1, 4, 4, 0}, {0, 1, -1, 8, -8, 1}}};
}

template <typename Number>
Matrix<Number> zeros(size_t rows, size_t columns) {
  return Matrix<Number>(rows, std::vector<Number>(columns));
}

template <typename Number>
Matrix<Number> product(const Matrix<Number>& a, const Matrix<Number>& b) {
  Matrix<Number> result = zeros<Number>(a.size(), b[0].size());
  for (size_t i = 0; i < a.size(); ++i)
    for (size_t j = 0; j < b[0].size(); ++j)
      for (size_t k = 0; k < b.size(); ++k) result[i][j] += a[i][k] * b[k][j];
  return result;
}

template <typename Number>
Matrix<Number> transposed(const Matrix<Number>& m) {
  Matrix<Number> result = zeros<Number>(m[0].size(), m.size());
  for (size_t i = 0; i < m.size(); ++i)
    for (size_t j = 0; j < m[0].size(); ++j) result[j][i] = m[i][j];
  return result;
}

// Holds the transforms of both directions.
template <typename Number>
struct Both {
  Transforms<Number> down, across;

  explicit Both(const Tile& tile)
      : down(transforms<Number>(tile.down)), across(transforms<Number>(tile.across)) {}
  // Returns one of the transforms of x, such as B^T x B.
  Matrix<Number> apply(Matrix<Number> Transforms<Number>::*matrix, const Matrix<Number>& x) const {
    return product(product(down.*matrix, x), transposed(across.*matrix));
  }
};

// A kernel of 5x5, with a row and a column of zeros, is four of 3x3 side by side.
int pieces_of(const Conv& conv) { return conv.kernel == 5 ? 4 : 1; }

// Returns the 3x3 taps of a kernel from (top, left) on.
template <typename Number>
Matrix<Number> filter_of(const Conv& conv, int o, int i, int top, int left) {
  Matrix<Number> g = zeros<Number>(3, 3);
  for (int y = 0; y < 3 && top + y < conv.kernel; ++y)
    for (int x = 0; x < 3 && left + x < conv.kernel; ++x)
      g[size_t(y)][size_t(x)] = Number(conv.at(o, i, top + y, left + x));
  return g;
}

// Returns the pixels from (top, left) on, with zeros outside of the image.
template <typename Number>
Matrix<Number> pixels_of(const Planes& image, int i, int top, int left, size_t rows, size_t columns) {
  Matrix<Number> d = zeros<Number>(rows, columns);
  for (size_t r = 0; r < rows; ++r) {
    for (size_t c = 0; c < columns; ++c) {
      const int y = top + int(r), x = left + int(c);
      if (y >= 0 && y < image.h && x >= 0 && x < image.w) d[r][c] = Number(image.at(i, y, x));
    }
  }
  return d;
}

template <typename Number>
Planes convolve(const Planes& image, const Conv& conv, const Both<Number>& f) {
  using F = Transforms<Number>;
  const size_t rows = f.down.input.size(), columns = f.across.input.size();
  const int height = int(f.down.output.size()), width = int(f.across.output.size());
  const int pad = conv.kernel / 2;
  const auto top_of = [](size_t piece) { return int(piece / 2) * 3; };
  const auto left_of = [](size_t piece) { return int(piece % 2) * 3; };
  // Each piece has all channels.
  const auto channels = size_t(conv.in), in = channels * size_t(pieces_of(conv)), out = size_t(conv.out);
  std::vector<Matrix<Number>> weights(out * in), inputs(in);
  for (size_t o = 0; o < out; ++o)
    for (size_t i = 0; i < in; ++i)
      weights[o * in + i] = f.apply(
          &F::weight,
          filter_of<Number>(conv, int(o), int(i % channels), top_of(i / channels), left_of(i / channels)));
  Planes result(conv.out, image.h, image.w);
  for (int top = 0; top < image.h; top += height) {
    for (int left = 0; left < image.w; left += width) {
      for (size_t i = 0; i < in; ++i)
        inputs[i] =
            f.apply(&F::input, pixels_of<Number>(image, int(i % channels), top - pad + top_of(i / channels),
                                                 left - pad + left_of(i / channels), rows, columns));
      for (size_t o = 0; o < out; ++o) {
        Matrix<Number> sums = zeros<Number>(rows, columns);
        for (size_t i = 0; i < in; ++i)
          for (size_t r = 0; r < rows; ++r)
            for (size_t c = 0; c < columns; ++c) sums[r][c] += weights[o * in + i][r][c] * inputs[i][r][c];
        const Matrix<Number> values = f.apply(&F::output, sums);
        for (int y = 0; y < std::min(height, image.h - top); ++y)
          for (int x = 0; x < std::min(width, image.w - left); ++x)
            result.at(int(o), top + y, left + x) = values[size_t(y)][size_t(x)];
      }
    }
  }
  return result;
}

void make_absolute(Matrix<double>& m) {
  for (auto& row : m)
    for (double& v : row) v = std::abs(v);
}

}  // namespace

Planes winograd(const Planes& x, const Conv& conv, const Tile& tile) {
  return convolve(x, conv, Both<double>(tile));
}

Planes winograd_in_floats(const Planes& x, const Conv& conv, const Tile& tile) {
  return convolve(x, conv, Both<float>(tile));
}

Planes winograd_magnitudes(const Bounded& x, const Conv& conv, const Tile& tile) {
  Both<double> both(tile);
  for (Transforms<double>* f : {&both.down, &both.across})
    for (Matrix<double>* m : {&f->input, &f->weight, &f->output}) make_absolute(*m);
  Conv weights = conv;
  for (double& w : weights.weight) w = std::abs(w);
  Planes reach = x.value;
  for (size_t i = 0; i < reach.data.size(); ++i) reach.data[i] = std::abs(reach.data[i]) + x.bound.data[i];
  return convolve(reach, weights, both);
}

int winograd_roundings(const Conv& conv, const Tile& tile) {
  const int products = conv.in * pieces_of(conv) * (tile.across == 1 ? conv.kernel : 1);
  return products + ((tile.down > 1) + (tile.across > 1)) * (4 + 4 + 6) + 2;
}

}  // namespace raymeld::reference

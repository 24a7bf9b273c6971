// Computes the layers of channel attention.
#include "reference/elements.h"

namespace raymeld::reference {

Bounded channel_means(const Bounded& x, Precision precision) {
  constexpr int kRuns = 128, kTree = 7, kDivision = 3;
  const int h = x.value.h, w = x.value.w, roundings = (h * w + kRuns - 1) / kRuns + kTree + kDivision;
  Bounded result = exact(Planes(x.value.c, 1, 1));
  for (int c = 0; c < x.value.c; ++c)
    store(result, c, 0, 0, mean_over(x, c, 0, 0, h, w, roundings), precision);
  return result;
}

Bounded attend(const Bounded& x, const Bounded& logits, const Bounded& residual, Precision precision) {
  const int channels = x.value.c, h = x.value.h, w = x.value.w;
  expect_shape(logits, channels, 1, 1);
  expect_shape(residual, channels, h, w);
  const auto formula = [](const auto& value, const auto& logit, const auto& added) {
    return sigmoid(logit) * value + added;
  };
  Bounded result = exact(Planes(channels, h, w));
  for (int c = 0; c < channels; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int column = 0; column < w; ++column) {
        store(result, c, y, column,
              evaluate(formula, at(x, c, y, column), at(logits, c, 0, 0), at(residual, c, y, column)),
              precision);
      }
    }
  }
  return result;
}

}  // namespace raymeld::reference

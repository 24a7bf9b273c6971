// Computes the layers that prepare the inputs of KPCN.
#include "reference/elements.h"

namespace raymeld::reference {

Bounded gradients(const Bounded& x, Precision precision) {
  const int channels = x.value.c, h = x.value.h, w = x.value.w;
  const auto difference = [](const auto& next, const auto& own) { return next - own; };
  Bounded result = exact(Planes(2 * channels, h, w));
  for (int c = 0; c < channels; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int column = 0; column < w; ++column) {
        const Element own = at(x, c, y, column);
        if (column + 1 < w)
          store(result, c, y, column, evaluate(difference, at(x, c, y, column + 1), own), precision);
        if (y + 1 < h)
          store(result, channels + c, y, column, evaluate(difference, at(x, c, y + 1, column), own),
                precision);
      }
    }
  }
  return result;
}

Bounded remainder(const Bounded& whole, const Bounded& part, Transfer transfer, Precision precision) {
  const int channels = whole.value.c, h = whole.value.h, w = whole.value.w;
  expect_shape(part, channels, h, w);
  Bounded result = exact(Planes(channels, h, w));
  const auto at_least_0 = [&]<typename T>(const T& a, const T& b) -> T {
    using std::max;
    return apply(transfer, T(max(T(invert(transfer, a) - invert(transfer, b)), T(0))));
  };
  for (int c = 0; c < channels; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int column = 0; column < w; ++column)
        store(result, c, y, column, evaluate(at_least_0, at(whole, c, y, column), at(part, c, y, column)),
              precision);
    }
  }
  return result;
}

Bounded remodulate(const Bounded& demodulated, const Bounded& albedo, const Bounded& rest, Transfer transfer,
                   Precision precision) {
  const int h = demodulated.value.h, w = demodulated.value.w;
  expect_shape(demodulated, 3, h, w);
  expect_shape(albedo, 3, h, w);
  expect_shape(rest, 3, h, w);
  Bounded result = exact(Planes(3, h, w));
  const auto sum = [&](const auto& compressed, const auto& own, const auto& added) {
    using std::exp;
    const auto radiance = (exp(kCompress * compressed) - 1) / kCompress * (own + kAlbedoFloor);
    return apply(transfer, radiance + invert(transfer, added));
  };
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        store(result, c, y, x,
              evaluate(sum, at(demodulated, c, y, x), at(albedo, c, y, x), at(rest, c, y, x)), precision);
      }
    }
  }
  return result;
}

}  // namespace raymeld::reference

#include <fmt/format.h>

#include <array>

#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::Fill;
using reference::Planes;
using reference::Precision;
using reference::random_planes;
using reference::Size;

struct Shuffle {
  const char* name;
  void (*layer)(Graph&, const std::string&, const Tensor&, const Tensor&);
  Bounded (*expected)(const Bounded&, int);
  bool deepens;  // true: the output has r * r times as many channels

  Size in(const Size& small, int r) const { return deepens ? Size{r * small.h, r * small.w} : small; }
  int channels_in(int channels, int r) const { return deepens ? channels : r * r * channels; }
};

constexpr Shuffle kShuffles[] = {
    {.name = "space_to_depth",
     .layer = space_to_depth,
     .expected = reference::space_to_depth,
     .deepens = true},
    {.name = "pixel_shuffle", .layer = pixel_shuffle, .expected = reference::pixel_shuffle, .deepens = false},
};

Planes random_input(const Shuffle& shuffle, int channels, const Size& small, int r, Fill fill, uint64_t seed,
                    Precision precision) {
  const auto [h, w] = shuffle.in(small, r);
  return round_to(random_planes(shuffle.channels_in(channels, r), h, w, fill, seed), precision);
}

void check_whole(Check& check, const Target& target, const Shuffle& shuffle, const Planes& x, int r,
                 Precision precision) {
  const Planes expected = shuffle.expected(reference::exact(x), r).value;
  LayerRun run(target, precision);
  const Tensor in = run.input("in", x), out = run.tensor("out", expected.c, expected.h, expected.w);
  shuffle.layer(run.graph(), "shuffle", in, out);
  run.run();
  check.same_bits(run.read(out), expected);
}

// Shuffles from a slice to a slice, whose neighbours must stay as they were.
void check_slices(Check& check, const Target& target, const Shuffle& shuffle, const Planes& x, int r,
                  Precision precision) {
  const Planes result = shuffle.expected(reference::exact(x), r).value;
  const auto other = [&](int channels, const Planes& like, uint64_t seed) {
    return round_to(random_planes(channels, like.h, like.w, Fill::kUniform, seed), precision);
  };
  const Planes in_front = other(x.c + 1, x, 2), before = other(2, result, 3), after = other(1, result, 4);
  LayerRun run(target, precision);
  const Tensor in = run.input("in", concat(in_front, x));
  const Tensor out = run.input("out", concat(concat(before, other(result.c, result, 5)), after));
  shuffle.layer(run.graph(), "shuffle", in.slice(uint32_t(in_front.c), uint32_t(x.c)),
                out.slice(2, uint32_t(result.c)));
  run.run();
  check.same_bits(run.read(out), concat(concat(before, result), after));
}

}  // namespace

void conform_shuffles(Collector& collector) {
  constexpr std::array kChannels{1, 3, 4, 5, 9};
  const Method method = plain_methods().front();
  for (const Shuffle& shuffle : kShuffles) {
    uint64_t next = 0;
    for (const Precision precision : kPrecisions) {
      for (const Size& size : collector.sizes()) {
        for (const Fill fill : {Fill::kUniform, Fill::kSpecials}) {
          const int r = 2 << next % 3, channels = kChannels[next % kChannels.size()];
          const Planes x = random_input(shuffle, channels, size, r, fill, ++next, precision);
          collector.run(
              shuffle.name, method, precision,
              fmt::format("by {}{}, {} x {} x {}", r, fill == Fill::kSpecials ? ", specials" : "", x.c, x.h,
                          x.w),
              [&](Check& check) { check_whole(check, collector.target(), shuffle, x, r, precision); });
        }
      }
      const Planes x = random_input(shuffle, 2, {5, 3}, 2, Fill::kUniform, 1, precision);
      collector.run(shuffle.name, method, precision, fmt::format("slices, {} x {} x {}", x.c, x.h, x.w),
                    [&](Check& check) { check_slices(check, collector.target(), shuffle, x, 2, precision); });
    }
  }
}

}  // namespace raymeld::conform

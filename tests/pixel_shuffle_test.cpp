#include <gtest/gtest.h>

#include "gpu.h"

namespace raymeld::test {
namespace {

using reference::exact;
using reference::Planes;
using reference::Precision;

class PixelShuffleTest : public GpuTest {};

TEST_F(PixelShuffleTest, IsBitExact) {
  int next = 0;
  for (const Precision precision : kPrecisions) {
    for (const Size& size : awkward_sizes()) {
      for (const Fill fill : {Fill::kUniform, Fill::kSpecials}) {
        const int r = std::array{2, 4, 8}[size_t(next % 3)];
        const int channels = std::array{1, 3, 4, 5, 9}[size_t(next++ % 5)];
        SCOPED_TRACE(
            fmt::format("{} x {}, {} channels, by {}, {}", size.h, size.w, channels, r, name_of(precision)));
        const Planes x = reference::round_to(
            random_planes(r * r * channels, size.h, size.w, fill, uint64_t(next)), precision);
        LayerRun run(precision);
        const Tensor in = run.input("in", x);
        const Tensor out = run.tensor("out", channels, r * size.h, r * size.w);
        pixel_shuffle(run.graph(), "shuffle", in, out);
        run.run();
        EXPECT_TRUE(same_bits(floats(run.read(out)), floats(reference::pixel_shuffle(exact(x), r).value)));
      }
    }
  }
}

TEST_F(PixelShuffleTest, ReadsAndWritesSlices) {
  const Size size{5, 3};
  const int channels = 2;
  const Planes x = random_planes(4 * channels, size.h, size.w, Fill::kUniform, 1);
  LayerRun run(Precision::kFp32);
  const Planes before = random_planes(4 * channels + 1, size.h, size.w, Fill::kUniform, 2);
  Planes both = before;
  both.data.insert(both.data.end(), x.data.begin(), x.data.end());
  both.c += x.c;
  const Tensor in = run.input("in", both);
  const Planes fill = random_planes(3 + channels, 2 * size.h, 2 * size.w, Fill::kUniform, 3);
  const Tensor out = run.input("out", fill);
  const Tensor part = out.slice(2, out.shape.channels - 3);
  pixel_shuffle(run.graph(), "shuffle", in.slice(uint32_t(before.c), uint32_t(x.c)), part);
  run.run();
  EXPECT_EQ(run.read(part).data, reference::pixel_shuffle(exact(x), 2).value.data);
  const size_t plane = size_t(fill.h) * size_t(fill.w);
  const Planes after = run.read(out);
  EXPECT_TRUE(std::equal(fill.data.begin(), fill.data.begin() + ptrdiff_t(2 * plane), after.data.begin()));
  EXPECT_TRUE(
      std::equal(fill.data.end() - ptrdiff_t(plane), fill.data.end(), after.data.end() - ptrdiff_t(plane)));
}

}  // namespace
}  // namespace raymeld::test

#include "shaders.h"

namespace postpass::shaders {
namespace {

constexpr uint32_t trace[] = {
#include "trace.inc"
};
constexpr uint32_t accumulate[] = {
#include "accumulate.inc"
};
constexpr uint32_t show[] = {
#include "show.inc"
};
constexpr uint32_t overlay[] = {
#include "overlay.inc"
};

}  // namespace

const std::span<const uint32_t> kTrace = trace, kAccumulate = accumulate, kShow = show, kOverlay = overlay;

}  // namespace postpass::shaders

#include "engine/staging_ring.h"

#include <algorithm>

namespace raymeld {
namespace {

constexpr uint64_t kLeastBytes = 1 << 20;  // less would cost more in submits than it saves

}  // namespace

StagingRing::StagingRing(const Device& device, uint64_t piece_bytes)
    : device_(device),
      piece_bytes_(std::max(piece_bytes, kLeastBytes)),
      host_(device, kPieces * piece_bytes_, Memory::kUpload, "staging"),
      ring_(device, kPieces) {}

std::byte* StagingRing::next() {
  commands_ = ring_.begin(piece_);
  return static_cast<std::byte*>(host_.mapped()) + piece_ * piece_bytes_;
}

void StagingRing::send(const Buffer& to, uint64_t offset_bytes, uint64_t size_bytes) {
  record_copy(device_, commands_, host_.handle(), to.handle(),
              {piece_ * piece_bytes_, offset_bytes, size_bytes});
  ring_.submit(piece_, {}, {});
  piece_ = (piece_ + 1) % kPieces;
}

}  // namespace raymeld

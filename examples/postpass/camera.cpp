#include "camera.h"

#include <array>
#include <cmath>

namespace postpass {
namespace {

using Vector = std::array<double, 3>;

constexpr Vector kTarget = {0.1, 0.7, -0.2};
constexpr double kTanHalfHeight = 0.55;

Vector normalized(const Vector& v) {
  const double length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  return {v[0] / length, v[1] / length, v[2] / length};
}

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

vec4 scaled(const Vector& v, double factor = 1) {
  return {float(factor * v[0]), float(factor * v[1]), float(factor * v[2]), 0};
}

}  // namespace

Camera camera_at(double time_s, double aspect) {
  const double angle = 0.75 * std::sin(0.45 * time_s), height = 1.2 + 0.25 * std::sin(0.31 * time_s);
  const Vector position = {2.1 * std::sin(angle), height, 2.5 * std::cos(angle)};
  const Vector forward =
      normalized({kTarget[0] - position[0], kTarget[1] - position[1], kTarget[2] - position[2]});
  const Vector right = normalized(cross(forward, {0, 1, 0}));
  return {scaled(position), scaled(right, kTanHalfHeight * aspect),
          scaled(cross(right, forward), kTanHalfHeight), scaled(forward)};
}

}  // namespace postpass

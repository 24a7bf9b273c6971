// What the filters of the joint base go by: surfaces alike in albedo and normal are averaged, with a binomial kernel.
#include "params.h"

struct Surface {
  vec3 albedo, normal;
};

float squared(vec3 v) { return dot(v, v); }

float squared_distance(Surface a, Surface b) {
  return squared((a.albedo - b.albedo) / RAYMELD_ALBEDO_WIDTH) + squared((a.normal - b.normal) / RAYMELD_NORMAL_WIDTH);
}

// Of the pixel dx and dy (-1, 0 or 1) away.
float binomial(int dx, int dy) { return (dy == 0 ? 0.5 : 0.25) * (dx == 0 ? 0.5 : 0.25); }

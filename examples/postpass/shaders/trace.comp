// Traces paths: one invocation traces all paths of a pixel, for LRHS or for all layers of HRLS.
//
// Layers are those of Cycles, which the models were trained on. Albedo and normal are those of the first
// surface that neither mirrors nor refracts; a lamp has its light, up to 1, as albedo, and no normal. Normals
// are in camera space: x to the right, y up and z away from the camera. Diffuse and specular are light,
// albedo included, sorted by the path's first scattering.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"
#include "scene.glsl"

layout(constant_id = 0) const bool kFull = true;

const uint kMostVertices = 6, kMostDiffuse = 3;
const float kMostIndirect = 4;  // the limit of a sample's indirect light, against fireflies
const float kPi = 3.14159265;
const float kFilterSigma = 0.38;  // width of the pixel filter in pixels, like Cycles' Blackman-Harris

uint random_state;

// Returns a number in [0, 1) by a PCG hash (Jarzynski and Olano 2020).
float random() {
  random_state = random_state * 747796405u + 2891336453u;
  const uint word = ((random_state >> ((random_state >> 28) + 4)) ^ random_state) * 277803737u;
  return float(((word >> 22) ^ word) >> 8) / 16777216.0;
}

vec2 random2() {
  const float x = random();
  return vec2(x, random());
}

vec2 gaussian() {
  const vec2 u = random2();
  const float phi = 2 * kPi * u.y;
  return sqrt(-2 * log(1 - u.x)) * vec2(cos(phi), sin(phi));
}

vec3 on_sphere(vec2 u) {
  const float z = 1 - 2 * u.x, r = sqrt(max(1 - z * z, 0)), phi = 2 * kPi * u.y;
  return vec3(r * cos(phi), r * sin(phi), z);
}

// Returns the reflectance between air and glass; `cosine` is on the side that the ray comes from.
float fresnel(float cosine, float eta) {
  const float refracted = 1 - eta * eta * (1 - cosine * cosine);
  if (refracted <= 0) return 1;
  const float other = sqrt(refracted);
  const float s = (eta * cosine - other) / (eta * cosine + other),
              p = (cosine - eta * other) / (cosine + eta * other);
  return (s * s + p * p) / 2;
}

struct Path {
  vec3 color, albedo, normal, diffuse, specular;
};

// Returns the lamp's light that a matte surface reflects, divided by its albedo.
vec3 lamp_light(vec3 point, vec3 normal, vec2 u) {
  const vec2 place = lamp_centre(constants.scene_s) + (2 * u - 1) * kLampHalf;
  const vec3 to = vec3(place.x, kRoomHigh.y, place.y) - point;
  const float distance = length(to);
  const vec3 direction = to / distance;
  const float cosines = max(dot(normal, direction), 0) * max(direction.y, 0);
  if (cosines <= 0) return vec3(0);
  const float area = 4 * kLampHalf.x * kLampHalf.y;
  return kEmission * (visible(Ray(point, direction), distance - 2 * kNear) * cosines * area /
                      (kPi * distance * distance));
}

Path trace(Ray ray) {
  Path path = Path(vec3(0), vec3(0), vec3(0), vec3(0), vec3(0));
  vec3 throughput = vec3(1), features = vec3(1);
  bool has_features = false;
  uint diffuse_count = 0;
  uint first = 0;  // the path's first scattering: 1 diffuse, 2 specular, 3 transmission
  for (uint vertex = 0; vertex < kMostVertices; ++vertex) {
    const Hit hit = intersect(ray);
    const vec3 point = ray.origin + hit.t * ray.direction;
    const Surface surface = surface_at(point, hit);
    const float cosine = -dot(ray.direction, hit.normal);
    const vec3 normal = cosine < 0 ? -hit.normal : hit.normal;
    const bool delta = surface.kind == kMirrorLike || surface.kind == kClear;

    if (kFull && !has_features) {
      if (delta) {
        features *= surface.albedo;
      } else {
        has_features = true;
        path.albedo = features * (surface.kind == kGlowing ? min(kEmission, vec3(1)) : surface.albedo);
        path.normal = surface.kind == kGlowing ? vec3(0) : normal;
      }
    }

    vec3 light = vec3(0);
    vec3 onward = vec3(0);
    bool ends = false;
    uint does = 0;
    if (surface.kind == kGlowing) {
      // lamp_light() has counted the lamp already if the path met a matte surface.
      if (diffuse_count == 0 && cosine > 0) light = throughput * kEmission;
      ends = true;
    } else if (surface.kind == kClear) {
      const float eta = cosine > 0 ? 1 / 1.5 : 1.5;
      const bool mirrors = random() < fresnel(abs(cosine), eta);
      onward = mirrors ? reflect(ray.direction, normal) : refract(ray.direction, normal, eta);
      does = mirrors ? 2 : 3;
    } else {
      const float mirrored = surface.kind == kCoated  ? fresnel(abs(cosine), 1 / 1.5)
                             : surface.kind == kMatte ? 0
                                                      : 1;
      const float chance = surface.kind == kCoated ? mix(0.2, 1, mirrored) : mirrored;
      if (random() < chance) {
        const float roughness = surface.kind == kMetal ? 0.25 : 0;
        onward = normalize(reflect(ray.direction, normal) + roughness * on_sphere(random2()));
        ends = dot(onward, normal) <= 0;
        throughput *= surface.kind == kCoated ? vec3(mirrored / chance) : surface.albedo;
        does = 2;
      } else {
        throughput *= surface.albedo * ((1 - mirrored) / (1 - chance));
        light = throughput * lamp_light(point + kNear * normal, normal, random2());
        onward = normalize(normal + 0.999 * on_sphere(random2()));
        ends = ++diffuse_count == kMostDiffuse;
        does = 1;
      }
    }
    if (vertex == 0) first = does;
    if (diffuse_count > 1 || (vertex > 0 && diffuse_count > 0))
      light *= min(1, kMostIndirect / max(max(light.r, max(light.g, light.b)), 1e-6));
    path.color += light;
    if (first == 1) path.diffuse += light;
    if (first == 2) path.specular += light;
    if (ends) break;
    ray = Ray(point + kNear * (dot(onward, normal) < 0 ? -normal : normal), onward);
  }
  return path;
}

// Returns the pixels that lead from a pixel's first surface, at its centre, to its place in the last frame,
// and its depths in this frame and in the last one.
vec4 motion_of(vec2 centre, vec2 size) {
  const Ray ray = Ray(constants.camera.position.xyz, direction_of(constants.camera, centre, size));
  const Hit hit = intersect(ray);
  const vec3 point = ray.origin + hit.t * ray.direction;
  const vec3 place = project(constants.last_camera, last_place(point, hit.object), size);
  const vec2 moved = place.z > 0 ? place.xy - centre : vec2(1e30);  // behind the camera is out of the frame
  return vec4(moved, project(constants.camera, point, size).z, place.z);
}

void main() {
  const ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = kFull ? full_size() : small_size();
  if (!inside(pixel, size)) return;
  const uint samples = kFull ? constants.hrls_samples : constants.lrhs_samples;
  random_state = (pixel.y * 8192u + pixel.x) * 2u + uint(kFull) + constants.frame * 0x9e3779b9u;
  for (uint i = 0; i < 3; ++i) random();

  Path sum = Path(vec3(0), vec3(0), vec3(0), vec3(0), vec3(0));
  for (uint sample_index = 0; sample_index < samples; ++sample_index) {
    const vec2 point = vec2(pixel) + 0.5 + kFilterSigma * gaussian();
    const Path path =
        trace(Ray(constants.camera.position.xyz, direction_of(constants.camera, point, vec2(size))));
    sum.color += path.color;
    sum.albedo += path.albedo;
    sum.normal += path.normal;
    sum.diffuse += path.diffuse;
    sum.specular += path.specular;
  }
  const Camera camera = constants.camera;
  const vec3 normal = vec3(dot(sum.normal, normalize(camera.right.xyz)),
                           dot(sum.normal, normalize(camera.up.xyz)), dot(sum.normal, camera.forward.xyz));
  for (uint c = 0; c < 3; ++c) {
    if (!kFull) {
      lrhs[at(c, pixel, size)] = sum.color[c] / samples;
      continue;
    }
    hrls[at(kColor + c, pixel, size)] = sum.color[c] / samples;
    hrls[at(kAlbedo + c, pixel, size)] = sum.albedo[c] / samples;
    hrls[at(kNormal + c, pixel, size)] = normal[c] / samples;
    hrls[at(kDiffuse + c, pixel, size)] = sum.diffuse[c] / samples;
    hrls[at(kSpecular + c, pixel, size)] = sum.specular[c] / samples;
  }
  if (!kFull || constants.has_motion == 0) return;
  const vec4 moved = motion_of(vec2(pixel) + 0.5, vec2(size));
  for (uint c = 0; c < 4; ++c) motion[at(c, pixel, size)] = moved[c];
}

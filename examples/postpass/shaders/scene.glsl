// Describes a room with a lamp at its ceiling, boxes and balls, in metres with y up. The lamp and the red
// ball move with time, in seconds.

struct Ray {
  vec3 origin;
  vec3 direction;  // a vector of length 1
};

struct Hit {
  float t;
  vec3 normal;  // points outwards
  uint object;
};

const uint kRoom = 0, kLamp = 1, kTallBox = 2, kLowBox = 3, kPlinth = 4, kGlassBall = 5, kGoldBall = 6,
           kMirrorBall = 7, kRedBall = 8;

const vec3 kRoomLow = vec3(-2.2, 0, -2.6), kRoomHigh = vec3(2.2, 2.5, 2.6);
const vec2 kLampHalf = vec2(0.75, 0.5);  // x, z
const vec3 kEmission = vec3(17, 15.5, 13);

const vec4 kGlass = vec4(-0.42, 0.36, 0.78, 0.36), kGold = vec4(0.42, 0.84, -0.5, 0.32);  // centre, radius
const vec4 kMirror = vec4(0.62, 0.3, 0.7, 0.3);

vec2 lamp_centre(float time_s) { return vec2(0.1 + 0.5 * sin(0.8 * time_s), -0.2); }

vec4 red_ball(float time_s) {
  return vec4(vec3(0.05, 0.17, 1.12) + (1 - cos(1.3 * time_s)) * vec3(0.3, 0, 0.25), 0.17);
}

const float kMiss = 1e30;
const float kNear = 1e-3;

// Returns the distance at which the ray enters the ball, or leaves it if the ray starts inside.
float hit_ball(Ray ray, vec4 ball) {
  const vec3 to = ball.xyz - ray.origin;
  const float along = dot(to, ray.direction);
  const float reach = ball.w * ball.w - dot(to, to) + along * along;
  const float root = sqrt(max(reach, 0));
  const float t = along - root > kNear ? along - root : along + root;
  return reach > 0 && t > kNear ? t : kMiss;
}

// Turns the axes about y by the angle of this sine and cosine.
vec3 turn(vec3 v, vec2 angle) {
  return vec3(angle.y * v.x - angle.x * v.z, v.y, angle.x * v.x + angle.y * v.z);
}

// Returns the distance at which the ray enters a box around the origin.
float hit_box(Ray ray, vec3 half_size, out vec3 normal) {
  const vec3 inverse = 1 / ray.direction;
  const vec3 middle = -ray.origin * inverse, reach = half_size * abs(inverse);
  const vec3 near = middle - reach, far = middle + reach;
  const float enter = max(near.x, max(near.y, near.z)), leave = min(far.x, min(far.y, far.z));
  normal = -sign(ray.direction) * vec3(equal(near, vec3(enter)));
  return enter < leave && enter > kNear ? enter : kMiss;
}

const vec2 kTallAngle = vec2(0.342, 0.94), kLowAngle = vec2(-0.5, 0.866);
const vec3 kTallCentre = vec3(-0.75, 0.65, -0.7), kTallHalf = vec3(0.34, 0.65, 0.34);
const vec3 kLowCentre = vec3(1.35, 0.3, -0.15), kLowHalf = vec3(0.3, 0.3, 0.3);
const vec3 kPlinthCentre = vec3(0.42, 0.26, -0.5), kPlinthHalf = vec3(0.42, 0.26, 0.42);

Ray into(Ray ray, vec3 centre, vec2 angle) {
  return Ray(turn(ray.origin - centre, angle), turn(ray.direction, angle));
}

void take(inout Hit hit, float t, vec3 normal, uint object) {
  if (t < hit.t) hit = Hit(t, normal, object);
}

void take_ball(inout Hit hit, Ray ray, vec4 ball, uint object) {
  const float t = hit_ball(ray, ball);
  if (t < hit.t) hit = Hit(t, (ray.origin + t * ray.direction - ball.xyz) / ball.w, object);
}

void take_box(inout Hit hit, Ray ray, vec3 centre, vec3 half_size, vec2 angle, uint object) {
  vec3 normal;
  const float t = hit_box(into(ray, centre, angle), half_size, normal);
  if (t < hit.t) hit = Hit(t, turn(normal, vec2(-angle.x, angle.y)), object);
}

// Returns the first hit. There always is one, as the room is closed.
Hit intersect(Ray ray) {
  const vec3 ahead = mix(kRoomLow, kRoomHigh, greaterThan(ray.direction, vec3(0)));
  const vec3 exits = (ahead - ray.origin) / ray.direction;
  Hit hit;
  hit.t = min(exits.x, min(exits.y, exits.z));
  hit.normal = -sign(ray.direction) * vec3(equal(exits, vec3(hit.t)));
  const vec2 place = abs((ray.origin + hit.t * ray.direction).xz - lamp_centre(constants.scene_s));
  hit.object = hit.normal.y < 0 && all(lessThan(place, kLampHalf)) ? kLamp : kRoom;
  take_box(hit, ray, kTallCentre, kTallHalf, kTallAngle, kTallBox);
  take_box(hit, ray, kLowCentre, kLowHalf, kLowAngle, kLowBox);
  take_box(hit, ray, kPlinthCentre, kPlinthHalf, vec2(0, 1), kPlinth);
  take_ball(hit, ray, kGlass, kGlassBall);
  take_ball(hit, ray, kGold, kGoldBall);
  take_ball(hit, ray, kMirror, kMirrorBall);
  take_ball(hit, ray, red_ball(constants.scene_s), kRedBall);
  return hit;
}

// Returns where a point of an object was in the last frame.
vec3 last_place(vec3 point, uint object) {
  const float now = constants.scene_s, last = constants.last_scene_s;
  if (object == kLamp) point.xz += lamp_centre(last) - lamp_centre(now);
  if (object == kRedBall) point += red_ball(last).xyz - red_ball(now).xyz;
  return point;
}

// Returns the share of a lamp's light that comes through from a distance. Glass lets most of it pass, because
// the path tracer has no caustics.
float visible(Ray ray, float distance) {
  vec3 normal;
  float t = min(hit_ball(ray, kGold), hit_ball(ray, kMirror));
  t = min(t, hit_ball(ray, red_ball(constants.scene_s)));
  t = min(t, hit_box(into(ray, kTallCentre, kTallAngle), kTallHalf, normal));
  t = min(t, hit_box(into(ray, kLowCentre, kLowAngle), kLowHalf, normal));
  t = min(t, hit_box(into(ray, kPlinthCentre, vec2(0, 1)), kPlinthHalf, normal));
  const float glass = hit_ball(ray, kGlass) < distance ? 0.85 : 1;
  return t < distance ? 0 : glass;
}

const uint kMatte = 0, kCoated = 1, kMetal = 2, kMirrorLike = 3, kClear = 4, kGlowing = 5;

struct Surface {
  vec3 albedo;
  uint kind;
};

Surface surface_at(vec3 point, Hit hit) {
  if (hit.object == kLamp) return Surface(vec3(0), kGlowing);
  if (hit.object == kTallBox) return Surface(vec3(0.2, 0.32, 0.6), kMatte);
  if (hit.object == kLowBox) return Surface(vec3(0.7, 0.62, 0.3), kMatte);
  if (hit.object == kPlinth) return Surface(vec3(0.62, 0.6, 0.57), kMatte);
  if (hit.object == kGlassBall) return Surface(vec3(1), kClear);
  if (hit.object == kGoldBall) return Surface(vec3(0.95, 0.7, 0.35), kMetal);
  if (hit.object == kMirrorBall) return Surface(vec3(0.92), kMirrorLike);
  if (hit.object == kRedBall) return Surface(vec3(0.65, 0.06, 0.05), kCoated);
  if (hit.normal.y > 0.5) {  // tiles
    const vec2 tile = floor(point.xz / 0.44);
    const bool odd = mod(tile.x + tile.y, 2) > 0.5;
    return Surface(odd ? vec3(0.55, 0.47, 0.38) : vec3(0.24, 0.2, 0.18), kCoated);
  }
  if (hit.normal.x > 0.5) return Surface(vec3(0.6, 0.13, 0.1), kMatte);
  if (hit.normal.x < -0.5) return Surface(vec3(0.14, 0.42, 0.16), kMatte);
  if (hit.normal.z > 0.5 || hit.normal.z < -0.5) {  // panels
    const bool groove = fract(point.x / 0.4) < 0.06 && point.y < 1.1;
    return Surface(point.y < 1.1 ? vec3(groove ? 0.25 : 0.5) * vec3(1, 0.95, 0.85) : vec3(0.73, 0.72, 0.68),
                   kMatte);
  }
  return Surface(vec3(0.75), kMatte);
}

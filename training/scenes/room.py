"""Builds a furnished room: textured shell with a window, models along the walls and on tables, lamps."""

import math

from mathutils import Matrix, Vector

import build
import materials


def shell(b, width, depth, height):
    """Builds floor, ceiling and four walls around the origin, all facing inwards.

    Returns the window's centre, its width, and the sign of the side on which it is.
    """
    rng = b.rng
    x, y = width / 2, depth / 2
    b.panel([(-x, -y, x, y)], Matrix(), b.surface(plain=0.05))
    ceiling = materials.new_material("ceiling")[0]
    b.panel([(-x, -y, x, y)], Matrix.Translation((0, 0, height)) @ Matrix.Rotation(math.pi, 4, "X"), ceiling)
    paper, accent = b.surface(plain=0.4), b.surface(plain=0.2)
    upright = Matrix.Rotation(math.pi / 2, 4, "X")
    window_w, window_h, sill = rng.uniform(0.8, 0.6 * depth), rng.uniform(0.8, 1.5), rng.uniform(0.3, 0.9)
    window_side = rng.choice((1, 3))
    # Each side is the far wall (+y) turned by a quarter more: 0 far, 1 left, 2 near, 3 right.
    for side in range(4):
        length, distance = ((width, y), (depth, x))[side % 2]
        half = length / 2
        pieces = [(-half, 0, half, height)]
        if side == window_side:
            w = window_w / 2
            top = min(sill + window_h, height - 0.1)
            pieces = [(-half, 0, -w, height), (w, 0, half, height), (-w, 0, w, sill), (-w, top, w, height)]
        matrix = Matrix.Rotation(side * math.pi / 2, 4, "Z") @ Matrix.Translation((0, distance, 0)) @ upright
        b.panel(pieces, matrix, accent if side == 0 else paper)
    sign = -1 if window_side == 1 else 1
    centre = Vector((sign * x, 0, sill + window_h / 2))
    frame = materials.new_material("frame")[0]
    for lean in (-0.5, 0, 0.5):
        bar = centre + Vector((0, lean * window_w, 0))
        b.box(bar - Vector((0.03, 0.025, window_h / 2)), bar + Vector((0.03, 0.025, window_h / 2)), frame)
    return centre, window_w, sign


def pictures(b, width, depth, height):
    rng = b.rng
    upright = Matrix.Rotation(math.pi / 2, 4, "X")
    for _ in range(rng.randint(1, 4)):
        w, h = rng.uniform(0.3, 1.2), rng.uniform(0.3, 0.9)
        side = rng.choice((0, 0, 1, 3))
        length, distance = ((width, depth / 2), (depth, width / 2))[side % 2]
        spot = (rng.uniform(w - length, length - w) / 2, distance - 0.02, rng.uniform(1.1, height - h))
        matrix = Matrix.Rotation(side * math.pi / 2, 4, "Z") @ Matrix.Translation(spot) @ upright
        if rng.random() < 0.2:
            material = b.glowing(rng.uniform(0.5, 3))
        else:
            material = materials.picture(rng, b.textures, b.folder, build.generated)
        b.panel([(-w / 2, 0, w / 2, h)], matrix, material)
    if rng.random() < 0.5:
        w, h = rng.uniform(0.6, 1.4), rng.uniform(0.5, 1)
        b.panel([(-w, -h, w, h)], Matrix.Translation((rng.uniform(-0.5, 0.5), 0, 0.008)), b.surface(plain=0))


def footprint(model, location, side):
    w, d = (model.size_m.x, model.size_m.y) if side % 2 == 0 else (model.size_m.y, model.size_m.x)
    return (location[0] - w / 2, location[1] - d / 2, location[0] + w / 2, location[1] + d / 2)


def overlaps(a, c):
    return a[0] < c[2] and c[0] < a[2] and a[1] < c[3] and c[1] < a[3]


def spot_for(b, model, width, depth):
    """Returns (location, quarter turns): against the far, left or right wall facing inwards, or free-standing."""
    rng, w, d = b.rng, model.size_m.x, model.size_m.y
    side = rng.choice((0, 0, 1, 3, 4))
    if side == 4:
        return Vector((rng.uniform(-0.3, 0.3) * width, rng.uniform(-0.15, 0.3) * depth, 0)), rng.choice((0, 2))
    length, distance = ((width, depth / 2), (depth, width / 2))[side % 2]
    along = rng.uniform(w - length, length - w) / 2 if w < length else 0
    location = Matrix.Rotation(side * math.pi / 2, 4, "Z") @ Vector((along, distance - d / 2 - 0.03, 0))
    return location, side


def furnish(b, width, depth, eye):
    rng = b.rng
    standing = [m for m in b.models if not m.hangs and m.size_m.z > 0.35 and m.size_m.x < 2.6]
    small = [m for m in b.models if not m.hangs and max(m.size_m) < 0.5]
    taken = [(eye[0] - 0.9, eye[1] - 0.9, eye[0] + 0.9, eye[1] + 1.2)]
    tops = []
    for _ in range(rng.randint(16, 30)):
        model = b.pick(standing)
        location, side = spot_for(b, model, width, depth)
        area = footprint(model, location, side)
        if len(tops) > 9 or any(overlaps(area, t) for t in taken):
            continue
        taken.append(area)
        b.place(model, location, side * math.pi / 2)
        tops.append((model, location))
    for model, location in tops:
        if small and 0.35 < model.size_m.z < 1.2 and min(model.size_m.x, model.size_m.y) > 0.4:
            b.place(b.pick(small), location + Vector((0, 0, model.size_m.z)), rng.uniform(0, 6.28))
        elif rng.random() < 0.3 and model.size_m.z < 1.2:
            b.shape(location + Vector((0, 0, model.size_m.z)), rng.uniform(0.1, 0.3))
    for _ in range(rng.randint(0, 3)):
        size = rng.uniform(0.2, 0.7)
        spot = Vector((rng.uniform(-0.4, 0.4) * width, rng.uniform(-0.2, 0.4) * depth, 0))
        area = (spot.x - size / 2, spot.y - size / 2, spot.x + size / 2, spot.y + size / 2)
        if not any(overlaps(area, t) for t in taken):
            taken.append(area)
            b.shape(spot, size)


def lamps(b, width, depth, height, window):
    """Adds daylight from the window, lamps under the ceiling, or both; absolute power does not matter."""
    rng = b.rng
    centre, window_w, sign = window
    lighting = rng.choice(("day", "day", "evening", "both"))
    if lighting != "evening":
        outside = centre + Vector((sign * 0.25, 0, 0.1))
        b.light("AREA", outside, outside - Vector((sign, 0, 0.25)), rng.uniform(80, 250), window_w * 1.1)
        if rng.random() < 0.4:
            b.light("SUN", (sign * 3, -1, rng.uniform(1, 3)), (0, 0, 0), rng.uniform(1, 6), rng.uniform(0.5, 5))
    if lighting == "evening":
        b.plain_sky(rng.uniform(0.02, 0.1))
    elif rng.random() < 0.3:
        b.hdri_sky(rng.uniform(0.2, 0.8))
    else:
        b.plain_sky(rng.uniform(0.3, 2))
    # Rooms lit through a window alone are too noisy to learn from.
    if rng.random() < 0.75:
        top = Vector((0, 0.1 * depth, height - 0.02))
        b.light("AREA", top, top - Vector((0, 0, 1)), rng.uniform(40, 150), rng.uniform(0.8, 2.5))
    if lighting == "day":
        return
    for _ in range(rng.randint(1, 3)):
        spot = Vector((rng.uniform(-0.35, 0.35) * width, rng.uniform(-0.35, 0.35) * depth, height - 0.15))
        kind = rng.choice(("AREA", "POINT", "SPOT", "bulb"))
        if kind == "bulb":
            emitter = materials.light_emitter(rng, rng.uniform(20, 80))
            b.shape(spot - Vector((0, 0, 0.4)), 0.2, rng.choice(("sphere", "torus", "dome", "cube")), emitter)
        else:
            b.light(kind, spot, spot - Vector((0, 0, 1)), rng.uniform(20, 120), rng.uniform(0.05, 0.6))


def room(b):
    rng = b.rng
    width, depth, height = rng.uniform(3, 5.5), rng.uniform(3.5, 6), rng.uniform(2.4, 3)
    eye = Vector((rng.uniform(-0.3, 0.3) * width, -depth / 2 + 0.3, rng.uniform(1.0, 1.7)))
    window = shell(b, width, depth, height)
    furnish(b, width, depth, eye)
    pictures(b, width, depth, height)
    lamps(b, width, depth, height, window)
    target = Vector((rng.uniform(-0.3, 0.3) * width, depth / 2, rng.uniform(0.4, 1.1)))
    b.camera(eye, target, rng.uniform(20, 40))
    return 2

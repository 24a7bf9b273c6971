"""Builds scenes other than rooms: studio shots, table tops, models under the sky, landscapes, architecture."""

import math

from mathutils import Matrix, Vector

import materials
import shapes

UPRIGHT = Matrix.Rotation(math.pi / 2, 4, "X")


def studio_lights(b, reach):
    rng = b.rng
    for _ in range(rng.randint(1, 3)):
        spot = Vector((rng.uniform(-2, 2), rng.uniform(-2, 0.8), rng.uniform(1, 2.5))) * reach
        kind = rng.choice(("AREA", "AREA", "AREA", "POINT", "SPOT"))
        b.light(kind, spot, (0, 0, 0), rng.uniform(30, 300) * reach**2, rng.uniform(0.1, 1.5) * reach)
    sky = rng.choice(("plain", "plain", "hdri"))
    if sky == "plain":
        b.plain_sky(rng.uniform(0.05, 0.6))
    else:
        b.hdri_sky(rng.uniform(0.3, 2))


def studio(b):
    """Builds an object before a backdrop."""
    rng = b.rng
    model = b.pick(b.models) if rng.random() < 0.7 else None
    reach = max(model.size_m) if model else 1
    b.scale_m = 0.5 * reach
    backdrop = b.surface(plain=0.1)
    b.panel([(-6 * reach, -6 * reach, 6 * reach, 2 * reach)], Matrix(), backdrop)
    wall = backdrop if rng.random() < 0.4 else b.surface(plain=0.1)
    b.panel([(-6 * reach, 0, 6 * reach, 6 * reach)], Matrix.Translation((0, 2 * reach, 0)) @ UPRIGHT, wall)
    if model:
        b.place(model, (0, 0, 0), rng.uniform(-0.8, 0.8))
    else:
        b.shape((0, 0, 0), reach)
    for _ in range(rng.randint(2, 6)):
        angle, distance = rng.uniform(0, 6.28), rng.uniform(0.6, 1.2) * reach
        b.shape((distance * math.cos(angle), distance * math.sin(angle), 0), reach * rng.uniform(0.15, 0.4))
    studio_lights(b, reach)
    eye = Vector((rng.uniform(-0.8, 0.8), -1.6, rng.uniform(0.3, 1.2))) * reach
    b.camera(eye, (0, 0, (model.size_m.z if model else reach) * 0.4), rng.uniform(28, 50))
    return reach


def tabletop(b):
    """Builds a close look at small things on a table: shapes, small models, books, balls in rows."""
    rng = b.rng
    b.scale_m = 0.25
    b.box((-1, -0.7, -0.04), (1, 0.7, 0), b.surface(plain=0.02))
    b.panel([(-3, 0, 3, 2)], Matrix.Translation((0, 1.2, -0.7)) @ UPRIGHT, b.surface(plain=0.1))
    if rng.random() < 0.5:
        w, h, turn = rng.uniform(0.2, 0.5), rng.uniform(0.15, 0.3), rng.uniform(-0.5, 0.5)
        b.panel([(-w, -h, w, h)], Matrix.Translation((0, 0, 0.002)) @ Matrix.Rotation(turn, 4, "Z"), b.surface(plain=0))
    taken = []

    def free(radius):
        for _ in range(30):
            spot = Vector((rng.uniform(-0.45, 0.45), rng.uniform(-0.3, 0.4), 0))
            if all((spot - other).length > radius + far for other, far in taken):
                taken.append((spot, radius))
                return spot
        return None

    small = [m for m in b.models if 0.04 < max(m.size_m) < 0.5]
    for _ in range(rng.randint(0, 4) if small else 0):
        model = b.pick(small)
        if spot := free(max(model.size_m.xy) / 2):
            b.place(model, spot, rng.uniform(0, 6.28))
    for _ in range(rng.randint(5, 12)):
        size = rng.uniform(0.05, 0.25)
        if spot := free(size / 2):
            b.shape(spot, size)
    for _ in range(rng.randint(0, 3)):
        if spot := free(0.12):
            pile(b, spot)
    if rng.random() < 0.4:
        name, size, make = rng.choice(list(shapes.MESH)), rng.uniform(0.02, 0.06), b.surface(plain=0)
        for i in range(rng.randint(5, 14)):
            b.shape((-0.45 + 0.9 * i / 13, -0.34, 0), size, name, rng.choice((make, None)))
    studio_lights(b, 0.8)
    eye = Vector((rng.uniform(-0.5, 0.5), rng.uniform(-0.9, -0.55), rng.uniform(0.15, 0.7)))
    b.camera(eye, (rng.uniform(-0.1, 0.1), rng.uniform(-0.05, 0.15), 0.06), rng.uniform(28, 60), blur=0.5)
    return 0.5


def pile(b, spot):
    """Piles books on one another."""
    rng, z = b.rng, 0
    for _ in range(rng.randint(2, 7)):
        x, y, height = rng.uniform(0.06, 0.1), rng.uniform(0.08, 0.13), rng.uniform(0.01, 0.04)
        book = b.box((-x, -y, -height / 2), (x, y, height / 2), b.surface(plain=0.2))
        book.location = spot + Vector((0, 0, z + height / 2))
        book.rotation_euler[2] = rng.uniform(-0.4, 0.4)
        z += height


def fence(b, x0, x1, y, height):
    rng = b.rng
    step, width = rng.uniform(0.08, 0.3), rng.uniform(0.02, 0.08)
    posts = int((x1 - x0) / step)
    bars = [((x0 + i * step, y, 0), (x0 + i * step + width, y + 0.03, height)) for i in range(posts)]
    bars += [((x0, y - 0.02, z * height), (x1, y, z * height + 0.05)) for z in (0.2, 0.8)]
    b.boxes(bars, b.surface(plain=0.5))


def outdoor(b):
    """Builds models and shapes on a plain before walls, fences and trees."""
    rng = b.rng
    b.panel([(-40, -40, 40, 40)], Matrix(), b.surface(plain=0.02))
    for _ in range(rng.randint(1, 4)):
        x, y = rng.uniform(-8, 8), rng.uniform(3, 12)
        b.box((x, y, 0), (x + rng.uniform(1, 6), y + rng.uniform(1, 4), rng.uniform(1, 6)), b.surface(plain=0.05))
    if rng.random() < 0.5:
        fence(b, -8, 8, rng.uniform(2.5, 3), rng.uniform(0.6, 2))
    if rng.random() < 0.5:
        green = b.surface(plain=0.3, hue=0.27)
        grass = shapes.blades(rng, 6000, 8, rng.uniform(0.08, 0.25), lambda x, y: 0)
        grass.data.materials.append(green)
    large = [m for m in b.models if max(m.size_m) > 0.4]
    for _ in range(rng.randint(4, 8)):
        b.place(b.pick(large), (rng.uniform(-3, 3), rng.uniform(-2, 3), 0), rng.uniform(0, 6.28))
    for _ in range(rng.randint(2, 6)):
        b.shape((rng.uniform(-3, 3), rng.uniform(-2, 3), 0), rng.uniform(0.3, 1.5))
    for _ in range(rng.randint(0, 2)):
        b.tree((rng.uniform(-5, 5), rng.uniform(2, 6), 0), rng.uniform(2, 6))
    b.daylight()
    b.camera((rng.uniform(-3, 3), rng.uniform(-5, -3), rng.uniform(0.8, 2.5)), (0, 0.5, 0.5), rng.uniform(28, 50))
    return 4


def landscape(b):
    """Builds hills with rocks, trees, huts and grass."""
    rng = b.rng
    b.scale_m = rng.uniform(1, 5)
    extent = 60
    land = shapes.terrain(rng, extent, rng.uniform(2, 8))
    land.data.materials.append(b.surface(plain=0, hue=rng.choice((0.07, 0.1, 0.25, 0.3, None))))

    def ground(x, y):
        return shapes.height_at(land, x, y)

    if rng.random() < 0.3:
        lake, _, shader = materials.new_material("water")
        shader.inputs["Base Color"].default_value = (0.02, 0.06, 0.08, 1)
        shader.inputs["Roughness"].default_value = rng.uniform(0.02, 0.2)
        level = sorted(ground(rng.uniform(-20, 20), rng.uniform(-20, 20)) for _ in range(20))[6]
        b.panel([(-30, -30, 30, 30)], Matrix.Translation((0, 0, level)), lake)
    stone = b.surface(plain=0, hue=0.08)
    for _ in range(rng.randint(4, 16)):
        x, y, size = rng.uniform(-8, 8), rng.uniform(-12, 8), rng.uniform(0.2, 2)
        b.shape((x, y, ground(x, y) - 0.2 * size), size, "rock", stone)
    for _ in range(rng.randint(1, 5)):
        x, y = rng.uniform(-8, 8), rng.uniform(-8, 12)
        b.tree((x, y, ground(x, y) - 0.1), rng.uniform(2, 7))
    for _ in range(rng.randint(0, 4)):
        x, y, size = rng.uniform(-9, 9), rng.uniform(-6, 12), rng.uniform(1, 4)
        z = ground(x, y)
        if rng.random() < 0.5:
            b.box((x, y, z - 2), (x + size, y + size, z + size * rng.uniform(0.6, 2)), b.surface(plain=0.1))
        else:
            b.shape((x, y, z - 0.1), size)
    grass = shapes.blades(rng, 8000, 16, rng.uniform(0.1, 0.4), lambda x, y: ground(x, y - 8))
    grass.location.y = -8
    grass.data.materials.append(b.surface(plain=0.3, hue=rng.choice((0.15, 0.22, 0.28))))
    b.daylight()
    eye = Vector((rng.uniform(-6, 6), -16, 0))
    eye.z = max(ground(eye.x, y) for y in (-16, -14, -12)) + rng.uniform(1.2, 4)
    b.camera(eye, (0, 0, ground(0, 0) + 1), rng.uniform(26, 50))
    return 8


def facade(b, x, y, width, height, depth):
    """Builds a house whose front, at y, has rows of framed windows."""
    rng = b.rng
    b.box((x, y, 0), (x + width, y + depth, height), b.surface(plain=0.05))
    across, up = rng.uniform(1, 2.2), rng.uniform(1.8, 3)
    w, h, bar = across * rng.uniform(0.3, 0.7), up * rng.uniform(0.35, 0.65), 0.06
    frames, panes = [], []
    for i in range(int(width / across)):
        for j in range(int(height / up)):
            left, low = x + (i + 0.5) * across - w / 2, (j + 0.5) * up - h / 2
            panes.append(((left, y - 0.02, low), (left + w, y, low + h)))
            for f in (0, 0.5, 1):
                frames.append(((left + f * w - bar / 2, y - 0.08, low), (left + f * w + bar / 2, y, low + h)))
            frames += [((left, y - 0.08, low + f * h), (left + w, y, low + f * h + bar)) for f in (0, 0.6, 1)]
            frames.append(((left - 0.1, y - 0.2, low - 0.1), (left + w + 0.1, y, low)))
    if frames:
        b.boxes(frames, b.surface(plain=0.6))
        pane, _, shader = materials.new_material("pane")
        shader.inputs["Base Color"].default_value = (0.03, 0.04, 0.05, 1)
        shader.inputs["Roughness"].default_value = 0.03
        b.boxes(panes, rng.choice((pane, pane, materials.light_emitter(rng, 2), b.glowing(2))))


def street(b):
    rng = b.rng
    x = -16
    while x < 14:
        width = rng.uniform(4, 9)
        facade(b, x, rng.uniform(4, 7), width, rng.uniform(4, 14), 6)
        x += width + rng.choice((0, 0, rng.uniform(0, 2)))
    b.box((-16, 2.5, 0), (16, 4.5, 0.15), b.surface(plain=0.05))
    fence(b, -10, 10, rng.uniform(1.8, 2.4), rng.uniform(0.8, 1.2))
    for _ in range(rng.randint(2, 6)):
        b.shape((rng.uniform(-5, 5), rng.uniform(-4, 1.5), 0), rng.uniform(0.5, 2))


def arcade(b):
    """Builds stone walls with arches from the wall factory, and columns."""
    rng = b.rng
    settings = dict(WallStart=-8, WallEnd=8, WallTop=rng.uniform(4, 7), Depth=0.6, DepthMinimum=0.4, DepthVariance=0.1)
    settings |= dict(Width=rng.uniform(0.5, 1.2), Height=rng.uniform(0.3, 0.6), HeightMinimum=0.2, EdgeOffset=0.3)
    settings |= dict(Opening1X=0.5, Opening1Z=0, Opening1Height=2.2, Opening1Width=1.6, Opening1TopArch=0.8)
    settings |= dict(Opening1Repeat=True, Opening1TopArchThickness=0.3, CrenelTog=rng.random() < 0.4, Grout=0.04)
    settings |= dict(GroutVariance=0.01, GroutDepth=0.05, Opening1Bevel=0.1)
    wall = shapes.wall(**settings)
    wall.location.y = 5
    wall.data.materials.append(b.surface(plain=0.05))
    stone, height = b.surface(plain=0.05), rng.uniform(2.5, 4)
    for i in range(rng.randint(4, 9)):
        for y in (1, 3):
            column(b, (-7 + 1.8 * i, y), 0.2, height, stone)
    b.box((-8, 0.7, height), (8, 3.3, height + 0.3), b.surface(plain=0.1))
    b.boxes([((-8, 0.2 - 0.35 * i, 0), (8, 0.7 - 0.35 * i, 0.6 - 0.15 * i)) for i in range(4)], stone)
    for _ in range(rng.randint(2, 5)):
        b.shape((rng.uniform(-4, 4), rng.uniform(-5, -1.5), 0), rng.uniform(0.4, 1.5))


def column(b, at, radius, height, material):
    x, y, half = *at, 1.5 * radius
    b.boxes([((x - half, y - half, z), (x + half, y + half, z + 0.15)) for z in (0, height - 0.15)], material)
    shapes.cylinder(radius, height - 0.3, (*at, height / 2)).data.materials.append(material)


def architecture(b):
    rng = b.rng
    b.panel([(-60, -60, 60, 60)], Matrix(), b.surface(plain=0.02))
    rng.choice((street, arcade))(b)
    people = [m for m in b.models if 0.4 < max(m.size_m) < 2.5]
    for _ in range(rng.randint(1, 4)):
        b.place(b.pick(people), (rng.uniform(-4, 4), rng.uniform(-5, 0), 0), rng.uniform(0, 6.28))
    for _ in range(rng.randint(0, 2)):
        b.tree((rng.uniform(-6, 6), rng.uniform(-3, 2), 0), rng.uniform(3, 6))
    b.daylight()
    eye = (rng.uniform(-6, 6), rng.uniform(-13, -8), rng.uniform(1.2, 5))
    b.camera(eye, (rng.uniform(-2, 2), 3, rng.uniform(1, 3)), rng.uniform(22, 45))
    return 6

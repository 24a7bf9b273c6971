"""Builds scenes that are hard to reconstruct: grilles, thin rails, lettering, glass, mirrors, dim indirect light."""

import math

import bpy
from mathutils import Matrix, Vector

import materials
import shapes

UPRIGHT = Matrix.Rotation(math.pi / 2, 4, "X")
WIDTH, DEPTH, HEIGHT = 4.0, 4.0, 2.6  # the room's, in metres; its middle is the origin, the camera looks along +y
SIGNS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789&%$#?!@abcdefghijklmnopqrstuvwxyz"


def shell(b):
    x, y = WIDTH / 2, DEPTH / 2
    b.panel([(-x, -y, x, y)], Matrix(), b.surface(plain=0.1))
    ceiling = Matrix.Translation((0, 0, HEIGHT)) @ Matrix.Rotation(math.pi, 4, "X")
    b.panel([(-x, -y, x, y)], ceiling, b.surface(plain=0.9))
    paper = b.surface(plain=0.5)
    for side in range(4):
        turn = Matrix.Rotation(side * math.pi / 2, 4, "Z")
        panel = turn @ Matrix.Translation((0, y, 0)) @ UPRIGHT
        b.panel([(-x, 0, x, HEIGHT)], panel, b.surface(plain=0.3) if side == 0 else paper)


def place_for(b):
    """Returns a random upright plane in front of the far wall, a little turned; its z axis faces the camera."""
    rng = b.rng
    spot = Vector((rng.uniform(-1.2, 1.2), rng.uniform(-0.2, 1.9), rng.uniform(0, 0.9)))
    return Matrix.Translation(spot) @ Matrix.Rotation(rng.uniform(-0.6, 0.6), 4, "Z") @ UPRIGHT


def finish(b):
    return b.rng.choice((b.surface(plain=0.7), materials.metal(b.rng)))


def bars(b, matrix, width, height, step, thick, material):
    """Builds the upright and level bars of a grille, as boxes in its plane."""
    across = [
        ((-width / 2 + i * step, 0, 0), (-width / 2 + i * step + thick, height, thick))
        for i in range(int(width / step))
    ]
    if b.rng.random() < 0.6:
        rise = step * b.rng.choice((1, 1, 2))
        across += [((-width / 2, j * rise, 0), (width / 2, j * rise + thick, thick)) for j in range(int(height / rise))]
    b.boxes(across, material).matrix_world = matrix


def grille(b):
    rng = b.rng
    thick = rng.uniform(0.002, 0.012)
    step = thick * rng.uniform(2.5, 8)
    size = (rng.uniform(0.3, 1.2), rng.uniform(0.3, 1.2))
    matrix = place_for(b)
    if rng.random() < 0.35:
        matrix = matrix @ Matrix.Rotation(math.pi / 4, 4, "Z")
    bars(b, matrix, *(min(side, 90 * step) for side in size), step, thick, finish(b))


def rail(b):
    """Builds posts and wires across the view."""
    rng = b.rng
    y, height, thick = rng.uniform(-0.6, 1.5), rng.uniform(0.5, 1.1), rng.uniform(0.003, 0.02)
    step = rng.uniform(0.08, 0.4)
    posts = [((-2 + i * step, y, 0), (-2 + i * step + thick, y + thick, height)) for i in range(int(4 / step))]
    wires = rng.randint(1, 9)
    posts += [
        ((-2, y, height * (j + 1) / wires), (2, y + thick / 2, height * (j + 1) / wires + thick / 2))
        for j in range(wires)
    ]
    b.boxes(posts, finish(b))


def lettering(b):
    rng = b.rng
    curve = bpy.data.curves.new("sign", "FONT")
    lines = rng.randint(1, 6)
    curve.body = "\n".join("".join(rng.choices(SIGNS, k=rng.randint(2, 14))) for _ in range(lines))
    curve.size, curve.extrude = rng.uniform(0.04, 0.35), rng.choice((0.001, 0.01))
    curve.align_x = "CENTER"
    sign = bpy.data.objects.new("sign", curve)
    bpy.context.collection.objects.link(sign)
    sign.matrix_world = place_for(b) @ Matrix.Translation((0, rng.uniform(0.3, 0.9), 0.02))
    dark = rng.random() < 0.5
    ink, _, shader = materials.new_material("ink")
    shader.inputs["Base Color"].default_value = (
        materials.colour(rng, 0.01, 0.2) if dark else materials.colour(rng, 0.6, 0.9)
    )
    curve.materials.append(
        rng.choice((ink, ink, ink, materials.metal(rng), materials.light_emitter(rng, rng.uniform(0.5, 4))))
    )
    if rng.random() < 0.6:
        w, h = rng.uniform(0.4, 1.1), rng.uniform(0.3, 0.8)
        board = b.surface(plain=0.7)
        b.panel([(-w, -h, w, h)], sign.matrix_world @ Matrix.Translation((0, 0, -0.02)), board)


def pane(b):
    """Builds a sheet of glass, thin or thick, before other things."""
    rng = b.rng
    w, h, thick = rng.uniform(0.3, 1), rng.uniform(0.4, 1.4), rng.choice((0.004, 0.01, 0.05))
    sheet = b.boxes([((-w / 2, 0, 0), (w / 2, h, thick))], materials.glass(rng))
    sheet.matrix_world = Matrix.Translation((0, rng.uniform(-0.9, 0), 0)) @ place_for(b)


def mirror(b):
    rng = b.rng
    w, h = rng.uniform(0.3, 1.4), rng.uniform(0.4, 1.6)
    material, _, shader = materials.new_material("mirror")
    shader.inputs["Base Color"].default_value = (0.9, 0.9, 0.9, 1)
    shader.inputs["Metallic"].default_value = 1
    shader.inputs["Roughness"].default_value = rng.choice((0, 0, 0.03, 0.1))
    matrix = place_for(b)
    b.panel([(-w / 2, 0, w / 2, h)], matrix, material)
    edge = 0.03
    frame = [
        ((-w / 2 - edge, -edge, -0.02), (w / 2 + edge, 0, 0.02)),
        ((-w / 2 - edge, h, -0.02), (w / 2 + edge, h + edge, 0.02)),
    ]
    frame += [((x - edge / 2, 0, -0.02), (x + edge / 2, h, 0.02)) for x in (-w / 2, w / 2)]
    b.boxes(frame, finish(b)).matrix_world = matrix


def vessels(b):
    """Builds glasses, bottles and polished vases in a row."""
    rng = b.rng
    spot, turn = Vector((rng.uniform(-1, 0.3), rng.uniform(-0.9, 1.2), 0)), rng.uniform(-0.4, 0.4)
    top = rng.choice((0, 0.4, 0.75))
    if top:
        b.box(spot + Vector((-0.1, -0.2, top - 0.03)), spot + Vector((1.3, 0.2, top)), b.surface(plain=0.3))
    for i in range(rng.randint(3, 8)):
        radius, height = rng.uniform(0.02, 0.07), rng.uniform(0.08, 0.4)
        foot = spot + Vector((0.16 * i, 0.16 * i * math.sin(turn) * 0.3, top))
        material = rng.choice((materials.glass, materials.glass, materials.metal))(rng)
        body = shapes.cylinder(radius, height, foot + Vector((0, 0, height / 2)))
        body.data.materials.append(material)
        if rng.random() < 0.6:
            neck = shapes.cylinder(radius * 0.4, height * 0.4, foot + Vector((0, 0, 1.2 * height)))
            neck.data.materials.append(material)
        if rng.random() < 0.4:
            b.shape(foot + Vector((0, 0.25, 0)), rng.uniform(0.08, 0.25))


def lights(b):
    """Adds lamps that are seen, or whose light reaches the walls only over the ceiling or from behind a screen."""
    rng = b.rng
    kind = rng.choice(("lamp", "lamp", "uplight", "screened", "window"))
    b.plain_sky(rng.uniform(0.02, 0.2))
    if kind == "lamp":
        for _ in range(rng.randint(1, 3)):
            spot = Vector((rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1.2), HEIGHT - 0.1))
            b.light(
                rng.choice(("AREA", "POINT", "SPOT")),
                spot,
                spot - Vector((0, 0, 1)),
                rng.uniform(20, 120),
                rng.uniform(0.05, 0.8),
            )
    elif kind == "uplight":
        spot = Vector((rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1), rng.uniform(0.5, 1.8)))
        b.light("AREA", spot, spot + Vector((0, 0, 1)), rng.uniform(50, 150), rng.uniform(0.2, 0.8))
    elif kind == "screened":
        x = rng.choice((-1.6, 1.6))
        b.box((x * 0.6, 0.2, 0), (x * 0.6 + 0.05, 1.6, 2), b.surface(plain=0.5))
        b.light("AREA", (x, 1, 1), (x * 0.6, 1, 1), rng.uniform(50, 200), rng.uniform(0.2, 0.8))
    else:
        spot = Vector((rng.choice((-1.95, 1.95)), rng.uniform(-1, 1.5), 1.4))
        b.light("AREA", spot, (0, 0.5, 0.6), rng.uniform(50, 200), rng.uniform(0.5, 1.5))
    if rng.random() < 0.3:
        b.light("POINT", (rng.uniform(-1, 1), -1.5, 2), (0, 0, 1), rng.uniform(2, 15), 0.3)


def details(b):
    rng = b.rng
    b.scale_m = rng.choice((0.3, 1))
    shell(b)
    for make in rng.choices((grille, rail, lettering, pane, mirror, vessels), k=rng.randint(4, 8)):
        make(b)
    things = [m for m in b.models if 0.1 < max(m.size_m) < 1.5]
    for _ in range(rng.randint(0, 4)):
        b.place(b.pick(things), (rng.uniform(-1.5, 1.5), rng.uniform(-0.5, 1.6), 0), rng.uniform(0, 6.28))
    for _ in range(rng.randint(1, 5)):
        b.shape((rng.uniform(-1.5, 1.5), rng.uniform(-0.6, 1.7), 0), rng.uniform(0.1, 0.6))
    lights(b)
    eye = Vector((rng.uniform(-1.2, 1.2), -1.85, rng.uniform(0.6, 1.8)))
    b.camera(eye, (rng.uniform(-0.6, 0.6), 1, rng.uniform(0.4, 1.1)), rng.uniform(20, 45))
    return 2

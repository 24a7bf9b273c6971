"""Builds the scenes of the test set, of layouts, materials and models that no training uses."""

import colorsys
import math

from mathutils import Matrix, Vector

import build
import materials

UPRIGHT = Matrix.Rotation(math.pi / 2, 4, "X")


def nodes_of(material):
    tree = material.node_tree

    def node(kind, **inputs):
        made = tree.nodes.new("ShaderNode" + kind)
        for name, value in inputs.items():
            socket = made.inputs[name.replace("_", " ")]
            if hasattr(value, "links"):
                tree.links.new(value, socket)
            else:
                socket.default_value = value
        return made

    return node


def ramp(node, height, *stops):
    made = node("ValToRGB", Fac=height)
    elements = made.color_ramp.elements
    while len(elements) < len(stops):
        elements.new(0.5)
    for element, (position, shade) in zip(elements, stops):
        element.position, element.color = position, (*shade, 1)
    return made.outputs["Color"]


def tint(rng, value, most=0.8):
    """Returns an RGB of the given HSV value and a random saturation up to `most`."""
    return colorsys.hsv_to_rgb(rng.random(), rng.uniform(0, most), value)


def shaded(rng, name, make):
    """Returns a material of make(node, position) -> (colour, height or None, roughness or a socket of it)."""
    material, tree, shader = materials.new_material(name)
    node = nodes_of(material)
    shade, height, roughness = make(node, node("TexCoord").outputs["Object"])
    tree.links.new(shade, shader.inputs["Base Color"])
    if hasattr(roughness, "links"):
        tree.links.new(roughness, shader.inputs["Roughness"])
    else:
        shader.inputs["Roughness"].default_value = roughness
    if height:
        bump = node("Bump", Height=height, Distance=0.004, Strength=0.6)
        tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    return material


def parquet(rng, across=0.09, value=0.35):
    def make(node, position):
        turned = node("Mapping", Vector=position, Rotation=(0, 0, rng.choice((0, 0.785, 1.571)))).outputs["Vector"]
        stretched = node("Mapping", Vector=turned, Scale=(1.5, 30, 30)).outputs["Vector"]
        light, dark = (value * 1.2, value * 0.7, value * 0.35), (value * 0.5, value * 0.25, value * 0.1)
        board = node("TexBrick", Vector=turned, Scale=1, Brick_Width=across * 8, Row_Height=across, Mortar_Size=0.0015)
        board.inputs["Color1"].default_value, board.inputs["Color2"].default_value = (*light, 1), (*dark, 1)
        board.inputs["Mortar"].default_value = (0.01, 0.005, 0.002, 1)
        grain = node("TexNoise", Vector=stretched, Scale=2, Detail=8).outputs["Fac"]
        vein = ramp(node, grain, (0.3, (0.45, 0.4, 0.35)), (0.7, (1, 1, 1)))
        mixed = node("MixRGB", Fac=0.9, Color1=board.outputs["Color"], Color2=vein)
        mixed.blend_type = "MULTIPLY"
        return mixed.outputs["Color"], board.outputs["Fac"], rng.uniform(0.2, 0.5)

    return shaded(rng, "parquet", make)


def marble(rng, dark=False):
    def make(node, position):
        bend = node("TexNoise", Vector=position, Scale=3, Detail=8).outputs["Color"]
        bent = node("MixRGB", Fac=0.35, Color1=position, Color2=bend).outputs["Color"]
        vein = node("TexWave", Vector=bent, Scale=2, Distortion=9, Detail=5).outputs["Fac"]
        ground, line = ((0.04, 0.05, 0.06), (0.7, 0.65, 0.5)) if dark else ((0.8, 0.79, 0.76), (0.25, 0.27, 0.3))
        return ramp(node, vein, (0.02, line), (0.14, ground), (0.9, ground)), None, rng.uniform(0.08, 0.25)

    return shaded(rng, "marble", make)


def terrazzo(rng):
    def make(node, position):
        chips = node("TexVoronoi", Vector=position, Scale=rng.uniform(25, 45))
        edge = ramp(node, chips.outputs["Distance"], (0.35, (1, 1, 1)), (0.42, (0, 0, 0)))
        chip = node("HueSaturation", Color=chips.outputs["Color"], Saturation=rng.uniform(0.3, 0.8), Value=0.8)
        shade = node("MixRGB", Fac=edge, Color1=(*tint(rng, 0.7), 1), Color2=chip.outputs["Color"])
        return shade.outputs["Color"], None, rng.uniform(0.12, 0.4)

    return shaded(rng, "terrazzo", make)


def tiles(rng, size_m=0.15):
    light, dark, joint = tint(rng, 0.75), tint(rng, 0.4), (0.5, 0.48, 0.45)

    def make(node, position):
        node_ = node("TexBrick", Vector=position, Scale=1, Brick_Width=size_m, Row_Height=size_m, Mortar_Size=0.004)
        node_.offset = rng.choice((0, 0, 0.5))
        node_.inputs["Color1"].default_value, node_.inputs["Color2"].default_value = (*light, 1), (*dark, 1)
        node_.inputs["Mortar"].default_value = (*joint, 1)
        return node_.outputs["Color"], node_.outputs["Fac"], rng.uniform(0.1, 0.5)

    return shaded(rng, "tiles", make)


def mosaic(rng):
    def make(node, position):
        cells = node("TexVoronoi", Vector=position, Scale=rng.uniform(8, 20))
        cells.distance = "CHEBYCHEV"
        rings = node("Math", Value=cells.outputs["Distance"])
        rings.operation = "PINGPONG"
        rings.inputs[1].default_value = 0.12
        stops = (0, tint(rng, 0.15)), (0.05, tint(rng, 0.7)), (0.12, tint(rng, 0.5))
        return ramp(node, rings.outputs["Value"], *stops), None, rng.uniform(0.15, 0.6)

    return shaded(rng, "mosaic", make)


def plaster(rng, value=0.7, most=0.35):
    def make(node, position):
        coarse = node("TexNoise", Vector=position, Scale=3, Detail=3).outputs["Fac"]
        fine = node("TexNoise", Vector=position, Scale=90, Detail=4).outputs["Fac"]
        high = tint(rng, value, most)
        low = tuple(0.75 * c for c in high)
        return ramp(node, coarse, (0.35, low), (0.65, high)), fine, 0.9

    return shaded(rng, "plaster", make)


def weave(rng, pitch_m=0.02):
    def make(node, position):
        def bands(direction):
            wave = node("TexWave", Vector=position, Scale=0.314 / pitch_m, Distortion=0.5)
            wave.bands_direction = direction
            return wave.outputs["Fac"]

        crossing = node("MixRGB", Fac=0.5, Color1=bands("X"), Color2=bands("Y")).outputs["Color"]
        return ramp(node, crossing, (0.2, tint(rng, 0.15)), (0.8, tint(rng, 0.7))), crossing, 0.95

    return shaded(rng, "weave", make)


def rust(rng):
    def make(node, position):
        patches = node("TexMusgrave", Vector=position, Scale=6, Detail=12).outputs["Fac"]
        rough = ramp(node, patches, (0.3, (0.25,) * 3), (0.6, (0.95,) * 3))
        paint = tint(rng, 0.45)
        shade = ramp(node, patches, (0.35, paint), (0.5, (0.25, 0.09, 0.03)), (0.8, (0.08, 0.03, 0.015)))
        return shade, patches, rough

    return shaded(rng, "rust", make)


def concrete(rng):
    def make(node, position):
        cloud = node("TexNoise", Vector=position, Scale=1.7, Detail=10).outputs["Fac"]
        pits = node("TexVoronoi", Vector=position, Scale=40).outputs["Distance"]
        return ramp(node, cloud, (0.35, (0.22, 0.22, 0.21)), (0.7, (0.5, 0.49, 0.47))), pits, rng.uniform(0.5, 0.9)

    return shaded(rng, "concrete", make)


class Set:
    """Places models by their names, and the walls they stand before."""

    def __init__(self, b):
        self.b, self.rng = b, b.rng
        self.by_name = {m.name: m for m in b.models}

    def put(self, name, x, y, z=0, degrees=0):
        """Places a model and returns the height of its top."""
        root = self.b.place(self.by_name[name], (x, y, z), math.radians(degrees))
        for material in {m for part in root.children for m in part.data.materials if m}:
            # Most files have 1, at which glass cannot be seen.
            material.node_tree.nodes["Principled BSDF"].inputs["IOR"].default_value = 1.45
        return z + self.by_name[name].size_m.z

    def width(self, name):
        return self.by_name[name].size_m.x

    def row(self, names, x0, x1, y, z, turn=25):
        """Places models with names drawn at random until the row is full."""
        x = x0
        while True:
            name = self.rng.choice(names)
            if x + self.width(name) > x1:
                return
            self.put(name, x + self.width(name) / 2, y, z, self.rng.uniform(-turn, turn))
            x += self.width(name) + self.rng.uniform(0.02, 0.08)

    def floor(self, material, half=8):
        return self.b.panel([(-half, -half, half, half)], Matrix(), material)

    def wall(self, material, x0, x1, y, height, degrees=0):
        """Builds a wall in front of a viewer at the origin who is turned by `degrees` to the left."""
        turn = Matrix.Rotation(math.radians(degrees), 4, "Z")
        return self.b.panel([(x0, 0, x1, height)], turn @ Matrix.Translation((0, y, 0)) @ UPRIGHT, material)

    def picture(self, x, y, z, width, height):
        frame = materials.new_material("frame")[0]
        frame.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.05, 0.03, 0.02, 1)
        self.b.box((x - width / 2 - 0.04, y, z - 0.04), (x + width / 2 + 0.04, y + 0.03, z + height + 0.04), frame)
        at = Matrix.Translation((x, y - 0.002, z)) @ UPRIGHT
        photograph = materials.picture(self.rng, self.b.textures, self.b.folder, build.generated)
        self.b.panel([(-width / 2, 0, width / 2, height)], at, photograph)

    def overhead(self, spots, power_w, size_m, z):
        for x, y in spots:
            self.b.light("AREA", (x, y, z), (x, y, 0), power_w, size_m)


POTS = ["vase1", "vase2", "vase3", "jar", "old_jar", "pottery", "bowl", "teapot", "candle"]
POTS += ["basic_camera", "bonsai-tree"]
FOOD = ["apples", "bowlWithFruits", "bowlWithSalad", "roasted-chicken", "frenchFries", "birthday_cake", "teapot", "cup"]
KITCHEN = ["coffee_machine", "toaster", "paperTowelHolder", "spiceTower", "kitchenKnifeStandSet", "squeezer", "cooker"]
TOOLS = ["marteau", "meuleuse-electrique", "perceuse-electrique", "scie-egoine", "rouleau-de-ruban-adhesif", "keys"]
WARES = ["sneakers", "woman_shoes", "casquette", "chapeau", "folded_clothes", "doll", "reflex_camera", "cardboard-box"]
SEATS = ["armchair", "armchair3", "modern_armchair", "rattanArmchair"]


def gallery(b):
    s, rng = Set(b), b.rng
    s.floor(rng.choice((parquet, terrazzo))(rng))
    s.wall(plaster(rng, 0.75), -5, 5, 3.5, 3.5)
    s.wall(plaster(rng, 0.5), -6, 6, 3.2, 3.5, 90)
    s.wall(plaster(rng, 0.6), -6, 6, 3.2, 3.5, -90)
    x = -2.6
    while x < 2.4:
        w = rng.uniform(0.6, 1.3)
        s.picture(x + w / 2, 3.46, rng.uniform(0.9, 1.2), w, rng.uniform(0.7, 1.3))
        x += w + 0.3
    for x in (-2, -0.7, 0.7, 2):
        height = rng.uniform(0.6, 1.1)
        b.box((x - 0.2, 1.3, 0), (x + 0.2, 1.7, height), rng.choice((marble(rng), marble(rng, True), concrete(rng))))
        s.put(rng.choice(POTS[:6] + ["bonsai-tree"]), x, 1.5, height, rng.uniform(0, 360))
    side = rng.choice((-1, 1))
    s.put(rng.choice(("wood_bank", "leather_sofa", "clear_sofa")), 2.3 * side, -0.2, 0, 90 * side)
    b.panel([(-1.2, -0.8, 1.2, 0.8)], Matrix.Translation((0, 0, 0.01)), weave(rng, 0.04))
    s.overhead([(-1.8, 1), (1.8, 1), (0, -1)], 90, 1.6, 3.4)
    b.plain_sky(0.15)
    b.camera((rng.uniform(-1.6, 1.6), -3.4, 1.6), (rng.uniform(-0.5, 0.5), 2, 1.1), rng.uniform(26, 34), blur=0)
    return 2


def shop(b):
    s, rng = Set(b), b.rng
    s.floor(tiles(rng, 0.4))
    s.wall(mosaic(rng), -4, 4, 1.4, 3)
    board = parquet(rng, 0.2, rng.uniform(0.3, 0.8))
    levels = [0.35, 0.8, 1.25, 1.7]
    for z in levels:
        b.box((-1.9, 0.95, z - 0.03), (1.9, 1.38, z), board)
    for x in (-1.9, -0.65, 0.65, 1.87):
        b.box((x, 0.95, 0), (x + 0.03, 1.38, 2.1), board)
    for z in levels:
        for x in (-1.87, -0.62, 0.68):
            s.row(WARES + POTS[:6] if z < 1.6 else POTS[:7], x, x + 1.2, 1.17, z)
    s.put("mannequinBrunette", -2.3, 0.2, 0, -20)
    s.put(rng.choice(("stroller", "clothes-rack", "tricycle")), 1.5, -0.3, 0, rng.uniform(-60, 60))
    s.put("shopping-basket", -0.8, -0.2, 0, rng.uniform(-60, 60))
    s.overhead([(-1.2, -0.6), (1.2, -0.6)], 120, 1.8, 2.9)
    b.plain_sky(0.4)
    b.camera((rng.uniform(-1, 1), -3.2, rng.uniform(1.2, 1.7)), (0, 1, 0.95), rng.uniform(28, 36), blur=0.3)
    return 2


def counter(b):
    s, rng = Set(b), b.rng
    b.box((-1.6, -0.35, 0.86), (1.6, 0.35, 0.9), rng.choice((marble(rng, True), terrazzo(rng), parquet(rng))))
    b.box((-1.6, -0.3, 0), (1.6, 0.35, 0.86), plaster(rng, 0.6))
    s.wall(tiles(rng, rng.choice((0.1, 0.15))), -3, 3, 0.37, 2.6)
    s.wall(plaster(rng), -3, 3, 1.7, 2.6, 90)
    s.row(KITCHEN, -1.1, 1.1, 0.17, 0.9, 20)
    s.row(FOOD, -1, 1, -0.14, 0.9, 60)
    b.box((-1.2, 0.12, 1.5), (1.2, 0.36, 1.53), parquet(rng))
    s.row(POTS[:8] + ["cup", "creamer", "sugar"], -1.1, 1.1, 0.24, 1.53)
    b.light("AREA", (1.9, -1.2, 2), (0, 0, 0.9), 70, 1.3)
    b.light("AREA", (-1.4, -1.3, 2.2), (0, 0.2, 0.9), 35, 1)
    b.plain_sky(0.3)
    eye = (rng.uniform(-0.6, 0.6), -1.5, rng.uniform(1.25, 1.55))
    b.camera(eye, (rng.uniform(-0.2, 0.2), 0.1, 1.08), rng.uniform(32, 44), blur=0.6)
    return 0.8


def courtyard(b):
    s, rng = Set(b), b.rng
    s.floor(rng.choice((tiles(rng, 0.3), mosaic(rng))), 20)
    for degrees in (0, 90, -90):
        s.wall(plaster(rng, rng.uniform(0.5, 0.8)), -5, 5, 5, rng.uniform(2.5, 5), degrees)
    for x in (-3.5, -1.2, 1.2, 3.5):
        s.put(rng.choice(("bush", "high-hedge", "hedge", "hedgeTextured")), x, 4.2)
    rim = concrete(rng)
    for i in range(24):
        turn = i * math.tau / 24
        at = Matrix.Translation((1.2 * math.cos(turn), 1.5 + 1.2 * math.sin(turn), 0.2))
        stone = b.box((-0.16, -0.14, 0), (0.16, 0.14, 0.4), rim)
        stone.matrix_world = at @ Matrix.Rotation(turn + math.pi / 2, 4, "Z")
    s.put(rng.choice(("maceta", "vase5")), 0, 1.5)
    for x, y, degrees in ((-2.4, 0.2, 40), (-1.5, -0.8, 100), (2.3, 0, -40)):
        s.put(rng.choice(("rattanArmchair", "rattanSofa", "wood_bank", "beach_chair")), x, y, 0, degrees)
    s.put("rattanTable", 1.7, -1.1, 0, 30)
    s.put(rng.choice(("dog", "cat", "rabbit")), 0.2, -0.8, 0, rng.uniform(-60, 60))
    s.put(rng.choice(("bicycle", "scooter2", "child_swing")), 3.2, 2.2, 0, rng.uniform(0, 90))
    sky = b.nishita_sky(1)
    # The sun shines from behind the camera, where no wall is.
    sky.sun_rotation, sky.sun_elevation = math.pi + rng.uniform(-0.9, 0.9), math.radians(rng.uniform(30, 50))
    sky.sun_size, sky.sun_intensity = math.radians(2), 1
    b.camera((rng.uniform(-2, 2), -5.2, rng.uniform(1.5, 2.6)), (0, 1.4, 0.7), rng.uniform(26, 34), blur=0)
    return 3


def workshop(b):
    s, rng = Set(b), b.rng
    s.floor(concrete(rng))
    s.wall(parquet(rng, 0.12, 0.5), -4, 4, 1.2, 3)
    s.wall(rust(rng), -4, 4, 2.6, 3, 90)
    bench = parquet(rng, 0.15, 0.4)
    b.box((-1.5, 0.3, 0.82), (1.5, 1.1, 0.9), bench)
    for x in (-1.4, 1.3):
        b.box((x, 0.4, 0), (x + 0.1, 1, 0.82), rust(rng))
    s.row(TOOLS + ["open-cardboard-box", "old_jar"], -1.4, 1.4, 0.55, 0.9, 70)
    s.row(["old_jar", "jar", "cardboard-box", "mini_stereo", "desk_lamp1", "stereo_amplifier"], -1.4, 1.4, 0.9, 0.9, 30)
    steel = materials.metal(rng)
    for i in range(9):
        b.box((-1.6 + 0.4 * i, 1.14, 1.3), (-1.57 + 0.4 * i, 1.19, 2.3), rust(rng) if i % 2 else steel)
    for _ in range(6):
        at = (rng.uniform(-1.4, 1.4), 1.12, rng.uniform(1.45, 2.1))
        gear = b.shape(at, rng.uniform(0.12, 0.4), "gear", rng.choice((rust(rng), steel)))
        gear.rotation_euler[0] = math.pi / 2
    s.put("step-ladder-wood", -2, 0, 0, 30)
    s.put(rng.choice(("mower", "bicycle", "furnace", "wood_logs")), 1.9, -0.3, 0, rng.uniform(-40, 40))
    s.put(rng.choice(("wood_logs", "open-cardboard-box", "cone")), -0.6, -0.3, 0, rng.uniform(0, 90))
    s.overhead([(-1.2, -0.4), (1.3, -0.5)], 100, 1.5, 2.8)
    b.plain_sky(0.3)
    b.camera((rng.uniform(-1.2, 1.2), -2.8, rng.uniform(1.4, 1.9)), (0, 0.7, 1), rng.uniform(28, 36), blur=0.3)
    return 1.5


def library(b):
    s, rng = Set(b), b.rng
    s.floor(parquet(rng, 0.07, 0.3))
    s.wall(plaster(rng, 0.5), -5, 5, 2.2, 3.2)
    wood = parquet(rng, 0.3, 0.25)
    covers = [weave(rng, 0.004), weave(rng, 0.006), marble(rng, True), rust(rng)]
    covers += [plaster(rng, rng.uniform(0.05, 0.7), 1) for _ in range(9)]
    shelves = [[] for _ in covers]
    for z in (0.1, 0.5, 0.9, 1.3, 1.7, 2.1):
        b.box((-2.6, 1.8, z - 0.03), (2.6, 2.2, z), wood)
        x = -2.6
        while x < 2.5:
            w, h = rng.uniform(0.015, 0.06), rng.uniform(0.2, 0.33)
            if rng.random() < 0.93:
                rng.choice(shelves).append(((x, 1.84, z), (x + w - 0.002, 2.1, z + h)))
            x += w
    for books, cover in zip(shelves, covers):
        b.boxes(books, cover)
    b.panel([(-1.3, -0.9, 1.3, 0.9)], Matrix.Translation((0, 0, 0.01)), weave(rng, 0.03))
    s.put(rng.choice(SEATS), -0.9, 0.5, 0, 35)
    s.put(rng.choice(SEATS), 1, 0.4, 0, -40)
    top = s.put(rng.choice(("coffee-table2", "rattanTable")), 0, -0.1)
    s.row(["teapot", "cup", "glasses", "tablet", "vase1", "bowlWithFruits"], -0.4, 0.4, -0.1, top, 40)
    s.put(rng.choice(("ficus", "maceta", "vase5")), 2.2, 1.2)
    b.light("AREA", (-2.6, -1, 2), (0, 0.8, 0.6), 130, 1.8)
    s.overhead([(0.6, 0)], 60, 1.4, 3)
    b.plain_sky(0.25)
    b.camera((rng.uniform(-1, 1), -3.1, rng.uniform(1.2, 1.7)), (0, 1, 0.95), rng.uniform(26, 34), blur=0.3)
    return 2


def terrace(b):
    s, rng = Set(b), b.rng
    b.panel([(-3, -3, 3, 3)], Matrix(), parquet(rng, 0.12, 0.6))
    b.panel([(-60, -60, 60, 60)], Matrix.Translation((0, 0, -3)), concrete(rng))
    for x in (-2.1, -0.7, 0.7, 2.1):
        s.put(rng.choice(("iron-railing-1", "iron-railing-2")), x, 2.8)
    s.wall(plaster(rng, 0.8), -3, 1.5, 2.9, 2.8, 90)
    top = s.put(rng.choice(("table-on-trestles", "white_kitchen_table", "metal_glass_table")), 0.2, 0.5)
    s.row(FOOD + ["wine_bottle", "candle", "vase3"], -0.4, 0.8, 0.55, top, 60)
    for x, y, degrees in ((-1.2, 0.5, 90), (1.6, 0.7, -80), (0.2, -0.6, 180)):
        chair = rng.choice(("plastic_chair", "white_kitchen_chair", "chair3"))
        s.put(chair, x, y, 0, degrees + rng.uniform(-20, 20))
    for x in (-2.4, 2.5):
        s.put(rng.choice(("ficus", "maceta", "bush")), x, 2.2)
    s.put(rng.choice(("cat", "dog", "doll-house")), -1.5, -0.8, 0, rng.uniform(-90, 90))
    b.panel([(-2.8, -2.8, -1.2, -1.4)], Matrix.Translation((0.8, 0.6, 0.005)), weave(rng, 0.05))
    b.hdri_sky(1, ("courtyard", "sunset", "city", "forest"))
    b.light("AREA", (-2, -3, 4), (0, 0.5, 0), 150, 3)
    b.camera((rng.uniform(-1.5, 1.5), -3.6, rng.uniform(1.4, 1.9)), (0, 0.6, 0.6), rng.uniform(26, 36), blur=0.4)
    return 2


def washroom(b):
    s, rng = Set(b), b.rng
    s.floor(mosaic(rng))
    s.wall(tiles(rng, 0.12), -3, 3, 1.5, 2.8)
    s.wall(tiles(rng, 0.2), -4, 4, 2.2, 2.8, 90)
    s.wall(terrazzo(rng), -4, 4, 2.2, 2.8, -90)
    s.put(rng.choice(("double_vanity", "bathroom_vanity")), -0.5, 1.2)
    s.put("islandBath", 0.9, 0.2, 0, rng.uniform(-30, 30))
    s.put("clothes-basket", -1.7, 0.6)
    s.put(rng.choice(("clothes_washing_machine", "dryer_machine")), 1.7, 1.1)
    s.row(["com_bath3_toalla", "com_bath2_soap", "folded_clothes", "com_bath"], 1.45, 2, 1.1, 0.85)
    b.panel([(-0.8, -0.5, 0.8, 0.5)], Matrix.Translation((-0.7, 0, 0.01)), weave(rng, 0.03))
    s.put("ficus", -1.9, 1.2)
    glass = materials.metal(rng)
    glass.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.03
    b.panel([(0.5, 1.1, 1.9, 2)], Matrix.Translation((0, 1.48, 0)) @ UPRIGHT, glass)
    s.picture(-0.5, 1.48, 1.6, 0.7, 0.8)
    s.overhead([(-0.8, 0), (1, 0)], 80, 1.3, 2.7)
    b.plain_sky(0.3)
    b.camera((rng.uniform(-0.8, 0.8), -2.7, rng.uniform(1.3, 1.7)), (0, 0.8, 0.8), rng.uniform(26, 33), blur=0)
    return 2


KINDS = {f.__name__: f for f in (gallery, courtyard, counter, library, terrace, shop, workshop, washroom)}

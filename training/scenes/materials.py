"""Makes seeded materials: procedural and photographed surfaces, glass, metal, light, haze; refinishes imported ones."""

import colorsys
import pathlib
import zipfile

import bpy


def colour(rng, low=0.05, high=0.85, hue=None):
    hue = rng.random() if hue is None else (hue + rng.uniform(-0.05, 0.05)) % 1
    r, g, b = colorsys.hsv_to_rgb(hue, rng.random() ** 2 * 0.9, rng.uniform(low, high))
    return (r, g, b, 1)


def new_material(name):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    return material, material.node_tree, material.node_tree.nodes["Principled BSDF"]


def coordinates(tree, rng, scale):
    source = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (scale, scale, scale)
    mapping.inputs["Rotation"].default_value[2] = rng.choice((0, 0, 1.5708, rng.random()))
    tree.links.new(source.outputs["Object"], mapping.inputs["Vector"])
    return mapping.outputs["Vector"]


def bricks(tree, rng):
    node = tree.nodes.new("ShaderNodeTexBrick")
    node.offset = rng.choice((0, 0.33, 0.5))
    node.inputs["Scale"].default_value = 1
    node.inputs["Brick Width"].default_value = rng.choice((0.1, 0.2, 0.4, 1.2))
    node.inputs["Row Height"].default_value = rng.choice((0.05, 0.08, 0.15, 0.4))
    node.inputs["Mortar Size"].default_value = rng.choice((0.003, 0.01))
    base = colour(rng)
    for socket in ("Color1", "Color2"):
        shade = rng.uniform(0.7, 1.15)
        node.inputs[socket].default_value = tuple(min(1, c * shade) for c in base[:3]) + (1,)
    node.inputs["Mortar"].default_value = colour(rng, 0.02, 0.4)
    return node


def checks(tree, rng):
    node = tree.nodes.new("ShaderNodeTexChecker")
    node.inputs["Scale"].default_value = rng.uniform(2, 20)
    node.inputs["Color1"].default_value = colour(rng, 0.4, 0.85)
    node.inputs["Color2"].default_value = colour(rng, 0.03, 0.4)
    return node


def waves(tree, rng):
    node = tree.nodes.new("ShaderNodeTexWave")
    node.wave_type = rng.choice(("BANDS", "RINGS"))
    node.inputs["Scale"].default_value = rng.uniform(0.5, 8)
    node.inputs["Distortion"].default_value = rng.choice((0, 2, 8))
    return node


def noise(tree, rng):
    node = tree.nodes.new("ShaderNodeTexNoise")
    node.inputs["Scale"].default_value = 10 ** rng.uniform(0.3, 2)
    node.inputs["Detail"].default_value = rng.uniform(1, 6)
    node.inputs["Distortion"].default_value = rng.choice((0, 0, 2))
    return node


def cells(tree, rng):
    node = tree.nodes.new("ShaderNodeTexVoronoi")
    node.feature = rng.choice(("F1", "F1", "F2", "SMOOTH_F1"))
    node.distance = rng.choice(("EUCLIDEAN", "MANHATTAN", "CHEBYCHEV"))
    node.inputs["Scale"].default_value = 10 ** rng.uniform(0.4, 1.7)
    return node


def musgrave(tree, rng):
    node = tree.nodes.new("ShaderNodeTexMusgrave")
    node.musgrave_type = rng.choice(("FBM", "RIDGED_MULTIFRACTAL", "HETERO_TERRAIN"))
    node.inputs["Scale"].default_value = 10 ** rng.uniform(0.2, 1.3)
    node.inputs["Detail"].default_value = rng.uniform(2, 10)
    return node


def magic(tree, rng):
    node = tree.nodes.new("ShaderNodeTexMagic")
    node.turbulence_depth = rng.randint(1, 5)
    node.inputs["Scale"].default_value = rng.uniform(1, 12)
    return node


PATTERNS = (bricks, bricks, checks, waves, noise, noise, cells, cells, musgrave, magic)


def ramp_of(tree, rng, height, hue):
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    elements = ramp.color_ramp.elements
    elements[0].position, elements[1].position = rng.uniform(0, 0.45), rng.uniform(0.55, 1)
    if rng.random() < 0.3:
        elements.new(0.5)
        ramp.color_ramp.interpolation = rng.choice(("LINEAR", "CONSTANT"))
    for element in elements:
        element.color = colour(rng, hue=hue)
    tree.links.new(height, ramp.inputs["Fac"])
    return ramp.outputs["Color"]


def pattern(tree, rng, vector, hue=None):
    """Adds a procedural texture; returns its (colour, height) sockets."""
    make = rng.choice(PATTERNS)
    node = make(tree, rng)
    tree.links.new(vector, node.inputs["Vector"])
    height = node.outputs["Distance" if make is cells else "Fac"]
    if make in (bricks, checks):
        return node.outputs["Color"], height
    return ramp_of(tree, rng, height, hue), height


def add_bump(tree, rng, shader, height, depth_m):
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value = rng.uniform(0.2, 1)
    bump.inputs["Distance"].default_value = depth_m
    bump.invert = rng.random() < 0.5
    tree.links.new(height, bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])


def finish(rng, shader, scale_m):
    """Draws roughness and, on some, coat, sheen, subsurface scattering or a metallic look."""
    shader.inputs["Roughness"].default_value = rng.uniform(0.08, 1)
    kind = rng.random()
    if kind < 0.1:
        shader.inputs["Clearcoat"].default_value = rng.uniform(0.3, 1)
    elif kind < 0.15:
        shader.inputs["Sheen"].default_value = rng.uniform(0.3, 1)
    elif kind < 0.21:
        shader.inputs["Subsurface"].default_value = rng.uniform(0.1, 0.6)
        shader.inputs["Subsurface Radius"].default_value = [rng.uniform(0.01, 0.1) * scale_m for _ in range(3)]
    elif kind < 0.26:
        shader.inputs["Metallic"].default_value = 1
        shader.inputs["Roughness"].default_value = rng.uniform(0.15, 0.5)
        shader.inputs["Anisotropic"].default_value = rng.choice((0, 0.7))


def photograph(rng, textures, folder):
    archive_path, member = rng.choice(textures)
    with zipfile.ZipFile(archive_path) as archive:
        archive.extract(member, folder)
    return bpy.data.images.load(str(pathlib.Path(folder) / member), check_existing=True)


def photograph_node(tree, rng, textures, folder, vector):
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = photograph(rng, textures, folder)
    tree.links.new(vector, node.inputs["Vector"])
    return node


def picture(rng, textures, folder, vector_of):
    material, tree, shader = new_material("picture")
    node = photograph_node(tree, rng, textures, folder, vector_of(tree))
    tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = rng.uniform(0.2, 0.9)
    return material


def surface(rng, textures, folder, plain=0.25, scale_m=1, hue=None):
    """Makes a floor, wall, cloth or object; coordinates are the object's own, patterns are of the order of scale_m."""
    if rng.random() < plain:
        material, tree, shader = new_material("plain")
        shader.inputs["Base Color"].default_value = colour(rng, 0.3, 0.9, hue)
        shader.inputs["Roughness"].default_value = rng.uniform(0.2, 1)
        return material
    material, tree, shader = new_material("surface")
    if rng.random() < 0.35 and hue is None:
        vector = coordinates(tree, rng, rng.uniform(0.4, 2) / scale_m)
        node = photograph_node(tree, rng, textures, folder, vector)
        node.projection, node.projection_blend = rng.choice((("FLAT", 0), ("BOX", 0.2)))
        shade, height = node.outputs["Color"], node.outputs["Color"]
    else:
        vector = coordinates(tree, rng, 1 / scale_m)
        shade, height = pattern(tree, rng, vector, hue)
        if rng.random() < 0.25:
            blend = tree.nodes.new("ShaderNodeMixRGB")
            blend.blend_type = rng.choice(("MULTIPLY", "MIX", "OVERLAY"))
            blend.inputs["Fac"].default_value = rng.uniform(0.3, 0.8)
            tree.links.new(shade, blend.inputs["Color1"])
            tree.links.new(pattern(tree, rng, vector, hue)[0], blend.inputs["Color2"])
            shade = blend.outputs["Color"]
    tree.links.new(shade, shader.inputs["Base Color"])
    finish(rng, shader, scale_m)
    if rng.random() < 0.4:
        add_bump(tree, rng, shader, height, scale_m * 10 ** rng.uniform(-2.7, -1.5))
    return material


def glass(rng):
    material, _, shader = new_material("glass")
    shader.inputs["Base Color"].default_value = colour(rng, 0.8, 1)
    shader.inputs["Transmission"].default_value = 1
    shader.inputs["Roughness"].default_value = rng.choice((0, 0, 0.15, 0.35))
    return material


def metal(rng):
    material, _, shader = new_material("metal")
    shader.inputs["Base Color"].default_value = colour(rng, 0.5, 0.95)
    shader.inputs["Metallic"].default_value = 1
    shader.inputs["Roughness"].default_value = rng.uniform(0.04, 0.5)
    shader.inputs["Anisotropic"].default_value = rng.choice((0, 0, 0.6))
    return material


def light_emitter(rng, strength):
    material, _, shader = new_material("emitter")
    shader.inputs["Emission"].default_value = (1, rng.uniform(0.6, 1), rng.uniform(0.3, 1), 1)
    shader.inputs["Emission Strength"].default_value = strength
    return material


def glowing(rng, textures, folder, strength, vector_of):
    """Makes a screen, a sign or a lit pattern: a photograph or a procedural texture drives the emission."""
    material, tree, shader = new_material("glowing")
    vector = vector_of(tree)
    if rng.random() < 0.5:
        shade = photograph_node(tree, rng, textures, folder, vector).outputs["Color"]
    else:
        shade = pattern(tree, rng, vector)[0]
    tree.links.new(shade, shader.inputs["Emission"])
    shader.inputs["Base Color"].default_value = (0.02, 0.02, 0.02, 1)
    shader.inputs["Emission Strength"].default_value = strength
    return material


def haze(rng, density):
    """Makes a homogeneous volume; `density` is in 1/m."""
    material = bpy.data.materials.new("haze")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
    volume.inputs["Color"].default_value = colour(rng, 0.6, 1)
    volume.inputs["Density"].default_value = density
    volume.inputs["Anisotropy"].default_value = rng.uniform(0, 0.6)
    tree.links.new(volume.outputs["Volume"], tree.nodes["Material Output"].inputs["Volume"])
    return material


def refinish(objects, rng):
    """Varies how imported materials reflect: as found, glossy, rough, metal or glass; textures stay."""
    # A dict keeps the order; a set's order of Blender objects, and with it every later draw, changes from run to run.
    for material in dict.fromkeys(m for o in objects if o.type == "MESH" for m in o.data.materials if m):
        shader = material.use_nodes and material.node_tree.nodes.get("Principled BSDF")
        if not shader:
            continue
        for node in list(material.node_tree.nodes):
            if node.type == "TEX_IMAGE" and not (node.image and node.image.size[0]):
                material.node_tree.nodes.remove(node)  # its file is missing from the catalogue
        kind = rng.random()
        if shader.inputs["Alpha"].default_value < 0.9 or kind > 0.95:
            shader.inputs["Transmission"].default_value = 1
            shader.inputs["Alpha"].default_value = 1
            shader.inputs["Roughness"].default_value = rng.choice((0, 0.1))
        elif kind > 0.85:
            shader.inputs["Metallic"].default_value = 1
            shader.inputs["Roughness"].default_value = rng.uniform(0.05, 0.5)
        elif kind > 0.4:
            shader.inputs["Roughness"].default_value = rng.uniform(0.05, 0.9)

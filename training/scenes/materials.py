"""Seeded materials: procedural and photographed surfaces, glass, metal, and a finish for imported models."""

import colorsys
import pathlib
import zipfile

import bpy


def colour(rng, low=0.05, high=0.85):
    r, g, b = colorsys.hsv_to_rgb(rng.random(), rng.random() ** 2 * 0.9, rng.uniform(low, high))
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


def bricks(tree, rng, vector):
    node = tree.nodes.new("ShaderNodeTexBrick")
    node.offset = rng.choice((0, 0.33, 0.5))
    node.inputs["Scale"].default_value = 1
    node.inputs["Brick Width"].default_value = rng.choice((0.2, 0.4, 1.2))
    node.inputs["Row Height"].default_value = rng.choice((0.08, 0.15, 0.4))
    node.inputs["Mortar Size"].default_value = rng.choice((0.003, 0.01))
    base = colour(rng)
    for socket in ("Color1", "Color2"):
        shade = rng.uniform(0.7, 1.15)
        node.inputs[socket].default_value = tuple(min(1, c * shade) for c in base[:3]) + (1,)
    node.inputs["Mortar"].default_value = colour(rng, 0.02, 0.4)
    return node


def checks(tree, rng, vector):
    node = tree.nodes.new("ShaderNodeTexChecker")
    node.inputs["Scale"].default_value = rng.uniform(2, 8)
    node.inputs["Color1"].default_value = colour(rng, 0.4, 0.85)
    node.inputs["Color2"].default_value = colour(rng, 0.03, 0.4)
    return node


def ramp_of(tree, rng, node):
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color = colour(rng)
    ramp.color_ramp.elements[1].color = colour(rng)
    ramp.color_ramp.elements[0].position = rng.uniform(0, 0.45)
    ramp.color_ramp.elements[1].position = rng.uniform(0.55, 1)
    tree.links.new(node.outputs["Fac"], ramp.inputs["Fac"])
    return ramp


def waves(tree, rng, vector):
    node = tree.nodes.new("ShaderNodeTexWave")
    node.wave_type = rng.choice(("BANDS", "RINGS"))
    node.inputs["Scale"].default_value = rng.uniform(0.5, 5)
    node.inputs["Distortion"].default_value = rng.choice((0, 2, 8))
    tree.links.new(vector, node.inputs["Vector"])
    return ramp_of(tree, rng, node)


def noise(tree, rng, vector):
    node = tree.nodes.new("ShaderNodeTexNoise")
    node.inputs["Scale"].default_value = 10 ** rng.uniform(0.3, 2)
    node.inputs["Detail"].default_value = rng.uniform(1, 6)
    tree.links.new(vector, node.inputs["Vector"])
    return ramp_of(tree, rng, node)


def photograph(rng, textures, folder):
    archive_path, member = rng.choice(textures)
    with zipfile.ZipFile(archive_path) as archive:
        archive.extract(member, folder)
    return bpy.data.images.load(str(pathlib.Path(folder) / member), check_existing=True)


def picture(rng, textures, folder, vector_of):
    material, tree, shader = new_material("picture")
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = photograph(rng, textures, folder)
    tree.links.new(vector_of(tree), node.inputs["Vector"])
    tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = rng.uniform(0.2, 0.9)
    return material


def surface(rng, textures, folder, plain=0.25):
    """A floor, wall, cloth or backdrop; texture coordinates are metres in the object's own frame."""
    if rng.random() < plain:
        material, tree, shader = new_material("plain")
        shader.inputs["Base Color"].default_value = colour(rng, 0.3, 0.9)
        shader.inputs["Roughness"].default_value = rng.uniform(0.2, 1)
        return material
    if rng.random() < 0.4:
        scale = rng.uniform(0.4, 2)
        return picture(rng, textures, folder, lambda tree: coordinates(tree, rng, scale))
    material, tree, shader = new_material("pattern")
    vector = coordinates(tree, rng, 1)
    node = rng.choice((bricks, bricks, checks, waves, noise))(tree, rng, vector)
    if "Vector" in node.inputs:
        tree.links.new(vector, node.inputs["Vector"])
    tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = rng.uniform(0.08, 1)
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
    shader.inputs["Roughness"].default_value = rng.uniform(0.02, 0.5)
    return material


def light_emitter(rng, strength):
    material, _, shader = new_material("emitter")
    shader.inputs["Emission"].default_value = (1, rng.uniform(0.6, 1), rng.uniform(0.3, 1), 1)
    shader.inputs["Emission Strength"].default_value = strength
    return material


def refinish(objects, rng):
    """Varies how imported materials reflect: as found, glossy, rough, metal or glass; textures stay."""
    # A dict, as a set's order of Blender objects, and with it every later draw, changes from run to run.
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

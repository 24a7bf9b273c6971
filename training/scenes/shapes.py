"""Makes shapes by code: Blender's primitives, shapes of the add-ons it ships with, trees, rocks, terrain, grass."""

import ast
import math
import pathlib

import addon_utils
import bpy
from mathutils import Matrix, Vector

ADD_ONS = (
    "add_curve_sapling",
    "add_mesh_BoltFactory",
    "add_mesh_extra_objects",
    "add_mesh_geodesic_domes",
    "ant_landscape",
)


def enable_add_ons():
    for name in ADD_ONS:
        addon_utils.enable(name)


def bounds(parts):
    """Returns the lowest and the highest corner of meshes' common bounding box, and the middle of its bottom."""
    corners = [o.matrix_world @ Vector(c) for o in parts for c in o.bound_box]
    low = Vector(min(c[i] for c in corners) for i in range(3))
    high = Vector(max(c[i] for c in corners) for i in range(3))
    return low, high, Vector(((low.x + high.x) / 2, (low.y + high.y) / 2, low.z))


def stand(parts, size_m):
    """Scales meshes together to a largest extent of size_m and stands them on the origin; returns the parts."""
    low, high, base = bounds(parts)
    change = Matrix.Scale(size_m / max(high - low), 4) @ Matrix.Translation(-base)
    for part in parts:
        part.data.transform(change @ part.matrix_world)
        part.matrix_world = Matrix()
    return parts


def made_by(operator, **settings):
    before = set(bpy.data.objects)
    operator(**settings)
    bpy.context.view_layer.update()
    return [o for o in bpy.data.objects if o not in before]


def gear(rng):
    teeth = rng.randint(8, 24)
    width, skew = rng.uniform(0.1, 0.5), rng.choice((0, 0.2))
    return bpy.ops.mesh.primitive_gear, dict(number_of_teeth=teeth, width=width, skew=skew)


def worm(rng):
    return bpy.ops.mesh.primitive_worm_gear, dict(number_of_rows=rng.randint(16, 40), row_height=0.1)


def super_toroid(rng):
    powers = {"n1": rng.choice((0.3, 1, 2.5)), "n2": rng.choice((0.3, 1, 2.5))}
    return bpy.ops.mesh.primitive_supertoroid_add, dict(u=64, v=32, r=rng.uniform(0.15, 0.45), **powers)


def twisted_torus(rng):
    return bpy.ops.mesh.primitive_twisted_torus_add, dict(twists=rng.randint(1, 6), major_segments=96, minor_segments=6)


def solid(rng):
    return bpy.ops.mesh.primitive_solid_add, dict(source=rng.choice(("6", "8", "12", "20")), vTrunc=rng.uniform(0, 1))


def gem(rng):
    return bpy.ops.mesh.primitive_gem_add, dict(segments=rng.randint(6, 16))


def bolt(rng):
    head = rng.choice(("bf_Head_Hex", "bf_Head_Cap", "bf_Head_Dome", "bf_Head_Pan"))
    bit = rng.choice(("bf_Bit_Allen", "bf_Bit_Philips"))
    return bpy.ops.mesh.bolt_add, dict(bf_Head_Type=head, bf_Bit_Type=bit, bf_Shank_Length=rng.uniform(0, 4))


def nut(rng):
    return bpy.ops.mesh.bolt_add, dict(bf_Model_Type="bf_Model_Nut")


def rock(rng):
    seed = rng.randint(1, 9999)
    return bpy.ops.mesh.add_mesh_rock, dict(use_random_seed=False, user_seed=seed, rough=rng.uniform(1, 5), detail=3)


def dome(rng):
    frequency = rng.randint(2, 5)
    return bpy.ops.mesh.generate_geodesic_dome, dict(base_type="Icosahedron", frequency=frequency)


MESH = {
    "sphere": lambda rng: (bpy.ops.mesh.primitive_uv_sphere_add, dict(segments=48, ring_count=24)),
    "cube": lambda rng: (bpy.ops.mesh.primitive_cube_add, {}),
    "torus": lambda rng: (bpy.ops.mesh.primitive_torus_add, dict(minor_radius=rng.uniform(0.1, 0.45))),
    "cone": lambda rng: (bpy.ops.mesh.primitive_cone_add, dict(depth=rng.uniform(1, 3))),
    "cylinder": lambda rng: (bpy.ops.mesh.primitive_cylinder_add, dict(depth=rng.uniform(0.5, 4), vertices=48)),
    "monkey": lambda rng: (bpy.ops.mesh.primitive_monkey_add, {}),
    "gear": gear,
    "worm": worm,
    "super toroid": super_toroid,
    "twisted torus": twisted_torus,
    "torus knot": lambda rng: (bpy.ops.mesh.primitive_torusknot_add, {}),
    "teapot": lambda rng: (bpy.ops.mesh.primitive_teapot_add, dict(resolution=8)),
    "teaspoon": lambda rng: (bpy.ops.mesh.primitive_teapot_add, dict(resolution=8, objecttype="2")),
    "gem": gem,
    "solid": solid,
    "star": lambda rng: (bpy.ops.mesh.primitive_star_add, dict(points=rng.randint(4, 12))),
    "round cube": lambda rng: (bpy.ops.mesh.primitive_round_cube_add, dict(radius=rng.uniform(0.1, 0.6))),
    "sponge": lambda rng: (bpy.ops.mesh.menger_sponge_add, dict(level=rng.randint(1, 2))),
    "pyramid": lambda rng: (bpy.ops.mesh.primitive_steppyramid_add, {}),
    "tee": lambda rng: (bpy.ops.mesh.primitive_tee_joint_add, {}),
    "elbow": lambda rng: (bpy.ops.mesh.primitive_elbow_joint_add, {}),
    "bolt": bolt,
    "nut": nut,
    "rock": rock,
    "dome": dome,
}
# Thin struts suit these shapes.
LATTICES = ("dome", "sponge", "solid", "sphere", "torus", "super toroid")


def mesh(rng, name, size_m):
    """Makes a named shape of MESH that stands on the origin, smooth but for its edges."""
    operator, settings = MESH[name](rng)
    part = stand(made_by(operator, **settings), size_m)[0]
    part.data.use_auto_smooth = True
    part.data.auto_smooth_angle = math.radians(35)
    part.data.polygons.foreach_set("use_smooth", [True] * len(part.data.polygons))
    if name in LATTICES and rng.random() < 0.35:
        part.modifiers.new("lattice", "WIREFRAME").thickness = size_m * rng.uniform(0.015, 0.04)
    return part


def cylinder(radius_m, height_m, middle):
    sizes = dict(radius=radius_m, depth=height_m, location=middle, vertices=48)
    part = made_by(bpy.ops.mesh.primitive_cylinder_add, **sizes)[0]
    part.data.use_auto_smooth = True
    part.data.polygons.foreach_set("use_smooth", [True] * len(part.data.polygons))
    return part


def wall(**settings):
    return made_by(bpy.ops.mesh.wall_add, **settings)[0]


def tree(rng, height_m):
    """Makes a Sapling tree; returns (trunk, leaves), of which leaves may be None."""
    presets = sorted((pathlib.Path(addon_utils.paths()[0]) / "add_curve_sapling" / "presets").glob("*.py"))
    settings = ast.literal_eval(rng.choice(presets).read_text())
    known = bpy.ops.curve.tree_add.get_rna_type().properties
    settings = {k: v for k, v in settings.items() if k in known}
    # Older presets have a single value in place of one for each level.
    arrays = [k for k in settings if getattr(known[k], "is_array", False) and not hasattr(settings[k], "__len__")]
    settings |= {k: [settings[k]] * known[k].array_length for k in arrays}
    settings |= dict(seed=rng.randint(0, 9999), bevel=True, bevelRes=1, resU=2, do_update=True)
    settings |= dict(makeMesh=False, armAnim=False, leafAnim=False, useArm=False, showLeaves=rng.random() < 0.9)
    settings["levels"] = min(settings["levels"], 3)
    parts = made_by(bpy.ops.curve.tree_add, **settings)
    trunk = next(o for o in parts if o.type == "CURVE")
    scale = height_m / max(trunk.dimensions.z, 0.1)
    trunk.matrix_world = Matrix.Scale(scale, 4)
    return trunk, next((o for o in parts if o.type == "MESH"), None)


def terrain(rng, extent_m, height_m):
    """Makes an extent_m wide square of hills around the origin."""
    kind = rng.choice(("hetero_terrain", "ridged_multi_fractal", "hybrid_multi_fractal", "multi_fractal", "fractal"))
    settings = dict(subdivision_x=160, subdivision_y=160, random_seed=rng.randint(0, 9999), noise_type=kind)
    settings |= dict(noise_size=rng.uniform(0.3, 1), strata_type=rng.choice(("0", "0", "1", "2")), edge_falloff="0")
    land = made_by(bpy.ops.mesh.landscape_add, refresh=True, **settings)[0]
    land.data.transform(Matrix.Diagonal((extent_m / 2, extent_m / 2, height_m, 1)))
    return land


def height_at(land, x, y):
    """Returns the height of a terrain at (x, y), or 0 beside the terrain."""
    hit, point, _, _ = land.ray_cast(Vector((x, y, 1000)), Vector((0, 0, -1)))
    return point.z if hit else 0


def blades(rng, count, extent_m, height_m, ground):
    """Makes grass, `count` thin triangles over a square; ground(x, y) gives the height of their feet."""
    corners, faces = [], []
    for i in range(count):
        x, y = rng.uniform(-0.5, 0.5) * extent_m, rng.uniform(-0.5, 0.5) * extent_m
        turn, width, height = rng.uniform(0, 6.28), 0.06 * height_m, height_m * rng.uniform(0.4, 1)
        side = Vector((math.cos(turn), math.sin(turn), 0)) * width
        foot = Vector((x, y, ground(x, y)))
        tip = foot + Vector((rng.uniform(-0.4, 0.4) * height, rng.uniform(-0.4, 0.4) * height, height))
        corners += [foot - side, foot + side, tip]
        faces.append((3 * i, 3 * i + 1, 3 * i + 2))
    data = bpy.data.meshes.new("grass")
    data.from_pydata(corners, [], faces)
    grass = bpy.data.objects.new("grass", data)
    bpy.context.collection.objects.link(grass)
    return grass

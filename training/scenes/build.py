"""Builds one seeded scene: a furnished room, an object before a backdrop, or models under the sky."""

import math

import bpy
from mathutils import Matrix, Vector

import materials


class Builder:
    def __init__(self, rng, models, textures, folder):
        self.rng, self.models, self.textures, self.folder = rng, models, textures, folder
        self.used = []

    def surface(self, plain=0.25):
        return materials.surface(self.rng, self.textures, self.folder, plain)

    def panel(self, rectangles, matrix, material):
        """Rectangles (x0, y0, x1, y1) in the panel's own plane, metres; its front faces +z."""
        corners, faces = [], []
        for x0, y0, x1, y1 in rectangles:
            faces.append(tuple(range(len(corners), len(corners) + 4)))
            corners += [(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)]
        mesh = bpy.data.meshes.new("panel")
        mesh.from_pydata(corners, [], faces)
        mesh.uv_layers.new()
        panel = bpy.data.objects.new("panel", mesh)
        panel.matrix_world = matrix
        mesh.materials.append(material)
        bpy.context.collection.objects.link(panel)
        return panel

    def box(self, low, high, material):
        middle, size = (Vector(low) + Vector(high)) / 2, Vector(high) - Vector(low)
        bpy.ops.mesh.primitive_cube_add(size=1, location=middle, scale=size)
        bpy.context.object.data.materials.append(material)
        return bpy.context.object

    def light(self, kind, location, target, power_w, size_m):
        data = bpy.data.lights.new("light", kind)
        data.energy = power_w
        data.color = (1, self.rng.uniform(0.7, 1), self.rng.uniform(0.5, 1))
        if kind == "AREA":
            data.shape, data.size, data.size_y = "RECTANGLE", size_m, size_m * self.rng.uniform(0.3, 1)
        elif kind == "SUN":
            data.angle = math.radians(size_m)
        else:
            data.shadow_soft_size = size_m
        light = bpy.data.objects.new("light", data)
        direction = Vector(target) - Vector(location)
        light.matrix_world = Matrix.Translation(location) @ direction.to_track_quat("-Z", "Y").to_matrix().to_4x4()
        bpy.context.collection.objects.link(light)
        return light

    def sky(self, strength, textured):
        world = bpy.data.worlds.new("world")
        bpy.context.scene.world = world
        world.use_nodes = True
        background = world.node_tree.nodes["Background"]
        background.inputs["Strength"].default_value = strength
        if textured:
            sky = world.node_tree.nodes.new("ShaderNodeTexSky")
            sky.sun_elevation = math.radians(self.rng.uniform(5, 70))
            sky.sun_rotation = self.rng.uniform(0, 6.28)
            sky.sun_size = math.radians(self.rng.uniform(0.5, 4))
            background.inputs["Strength"].default_value = strength * 0.1
            world.node_tree.links.new(sky.outputs["Color"], background.inputs["Color"])
        else:
            background.inputs["Color"].default_value = (self.rng.uniform(0.5, 1), 0.8, 1, 1)

    def camera(self, location, target, lens_mm):
        data = bpy.data.cameras.new("camera")
        data.lens = lens_mm
        camera = bpy.data.objects.new("camera", data)
        direction = Vector(target) - Vector(location)
        camera.matrix_world = Matrix.Translation(location) @ direction.to_track_quat("-Z", "Y").to_matrix().to_4x4()
        bpy.context.collection.objects.link(camera)
        bpy.context.scene.camera = camera
        if self.rng.random() < 0.25:
            data.dof.use_dof = True
            data.dof.focus_distance = direction.length * self.rng.uniform(0.6, 1.1)
            data.dof.aperture_fstop = self.rng.uniform(0.7, 2.8)

    def place(self, model, location, angle):
        root = model.load(self.folder)
        root.matrix_world = Matrix.Translation(location) @ Matrix.Rotation(angle, 4, "Z")
        bpy.context.view_layer.update()
        materials.refinish(root.children, self.rng)
        self.used.append(model.path)
        return root

    def shape(self, location, radius_m):
        add = self.rng.choice(
            (
                lambda: bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=radius_m),
                lambda: bpy.ops.mesh.primitive_cube_add(size=1.5 * radius_m),
                lambda: bpy.ops.mesh.primitive_torus_add(major_radius=0.7 * radius_m, minor_radius=0.3 * radius_m),
                lambda: bpy.ops.mesh.primitive_cone_add(radius1=radius_m, depth=2 * radius_m),
                lambda: bpy.ops.mesh.primitive_monkey_add(size=1.6 * radius_m),
            )
        )
        add()
        shape = bpy.context.object
        shape.location = Vector(location) + Vector((0, 0, radius_m))
        shape.rotation_euler[2] = self.rng.uniform(0, 6.28)
        pick = self.rng.choice((materials.glass, materials.metal, lambda rng: self.surface()))
        shape.data.materials.append(pick(self.rng))
        bpy.ops.object.shade_smooth()
        return shape


def outdoor(b):
    rng = b.rng
    b.panel([(-40, -40, 40, 40)], Matrix(), b.surface(plain=0.1))
    for _ in range(rng.randint(1, 4)):
        x, y = rng.uniform(-8, 8), rng.uniform(3, 12)
        b.box((x, y, 0), (x + rng.uniform(1, 6), y + rng.uniform(1, 4), rng.uniform(1, 6)), b.surface(plain=0.1))
    large = [m for m in b.models if max(m.size_m) > 0.4]
    for _ in range(rng.randint(5, 10)):
        b.place(rng.choice(large), (rng.uniform(-3, 3), rng.uniform(-2, 3), 0), rng.uniform(0, 6.28))
    for _ in range(rng.randint(0, 3)):
        b.shape((rng.uniform(-2, 2), rng.uniform(-2, 1), 0), rng.uniform(0.15, 0.5))
    b.sky(1, textured=True)
    b.camera((rng.uniform(-3, 3), rng.uniform(-5, -3), rng.uniform(0.8, 2.5)), (0, 0.5, 0.5), rng.uniform(28, 50))


def studio(b):
    rng = b.rng
    backdrop = b.surface(plain=0.2)
    b.panel([(-6, -6, 6, 2)], Matrix(), backdrop)
    wall = backdrop if rng.random() < 0.5 else b.surface(plain=0.2)
    b.panel([(-6, 0, 6, 6)], Matrix.Translation((0, 2, 0)) @ Matrix.Rotation(math.pi / 2, 4, "X"), wall)
    model = rng.choice(b.models)
    b.place(model, (0, 0, 0), rng.uniform(-0.8, 0.8))
    reach = max(model.size_m)
    for _ in range(rng.randint(1, 4)):
        angle = rng.uniform(0, 6.28)
        spot = (reach * math.cos(angle), 0.6 * reach * math.sin(angle) - 0.2 * reach, 0)
        b.shape(spot, reach * rng.uniform(0.08, 0.25))
    for _ in range(rng.randint(1, 3)):
        spot = (rng.uniform(-3, 3), rng.uniform(-3, 1), rng.uniform(1.5, 4))
        b.light(rng.choice(("AREA", "AREA", "POINT")), spot, (0, 0, 0), rng.uniform(30, 300), rng.uniform(0.05, 1.5))
    b.sky(rng.uniform(0.02, 0.5), textured=False)
    eye = Vector((rng.uniform(-0.8, 0.8), -1.6, rng.uniform(0.3, 1.0))) * (reach + 0.05)
    b.camera(eye, (0, 0, model.size_m.z * 0.45), rng.uniform(28, 45))

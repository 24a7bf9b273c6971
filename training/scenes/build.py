"""Builds the parts of all kinds of scenes: panels, boxes, models, shapes, lights, skies, the camera, motion, haze."""

import math
import pathlib

import bpy
from mathutils import Matrix, Vector

import furniture
import materials
import shapes


def towards(location, target):
    """Returns the pose of a camera or a light at `location` that looks at `target`."""
    turn = (Vector(target) - Vector(location)).to_track_quat("-Z", "Y")
    return Matrix.Translation(location) @ turn.to_matrix().to_4x4()


def generated(tree):
    return tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"]


def hdris():
    folder = pathlib.Path(bpy.utils.system_resource("DATAFILES")) / "studiolights" / "world"
    return {path.stem: path for path in sorted(folder.glob("*.exr"))}


class Builder:
    """Builds a scene; `scale_m` is the extent that patterns are made for: about 1 in rooms, less in close-ups."""

    def __init__(self, rng, models, textures, folder):
        self.rng, self.models, self.textures, self.folder = rng, models, textures, folder
        self.scale_m = 1
        self.used = []
        self.hdri = None
        self.movable = []

    def pick(self, models):
        """Picks a random model, for a skipped one its successor, so that other draws stay when one becomes skipped."""
        first = self.rng.randrange(len(models))
        return next(m for m in models[first:] + models if not furniture.is_skipped(m))

    def surface(self, plain=0.25, hue=None):
        return materials.surface(self.rng, self.textures, self.folder, plain, self.scale_m, hue)

    def glowing(self, strength, vector_of=generated):
        return materials.glowing(self.rng, self.textures, self.folder, strength, vector_of)

    def panel(self, rectangles, matrix, material):
        """Builds rectangles (x0, y0, x1, y1) in the panel's own plane, in metres; its front faces +z."""
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

    def boxes(self, bounds, material):
        """Builds one object of axis-aligned boxes (low, high)."""
        corners, faces = [], []
        for low, high in bounds:
            first = len(corners)
            corners += [(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
            sides = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
            faces += [tuple(first + i for i in side) for side in sides]
        mesh = bpy.data.meshes.new("boxes")
        mesh.from_pydata(corners, [], faces)
        mesh.materials.append(material)
        boxes = bpy.data.objects.new("boxes", mesh)
        bpy.context.collection.objects.link(boxes)
        return boxes

    def box(self, low, high, material):
        middle = (Vector(low) + Vector(high)) / 2
        box = self.boxes([(Vector(low) - middle, Vector(high) - middle)], material)
        box.location = middle
        return box

    def light(self, kind, location, target, power_w, size_m):
        """Adds a light; `size_m` is a diameter, or degrees for a SUN."""
        data = bpy.data.lights.new("light", kind)
        data.energy = power_w
        data.color = (1, self.rng.uniform(0.7, 1), self.rng.uniform(0.5, 1))
        if kind == "AREA":
            data.shape, data.size, data.size_y = "RECTANGLE", size_m, size_m * self.rng.uniform(0.3, 1)
        elif kind == "SUN":
            data.angle = math.radians(size_m)
        else:
            data.shadow_soft_size = size_m / 2
        if kind == "SPOT":
            data.spot_size, data.spot_blend = math.radians(self.rng.uniform(30, 90)), self.rng.random()
        light = bpy.data.objects.new("light", data)
        light.matrix_world = towards(location, target)
        bpy.context.collection.objects.link(light)
        return light

    def world(self, strength):
        world = bpy.data.worlds.new("world")
        bpy.context.scene.world = world
        world.use_nodes = True
        background = world.node_tree.nodes["Background"]
        background.inputs["Strength"].default_value = strength
        return world.node_tree, background

    def plain_sky(self, strength):
        _, background = self.world(strength)
        background.inputs["Color"].default_value = (self.rng.uniform(0.5, 1), 0.8, 1, 1)

    def nishita_sky(self, strength):
        tree, background = self.world(0.1 * strength)
        sky = tree.nodes.new("ShaderNodeTexSky")
        sky.sun_elevation = math.radians(self.rng.uniform(4, 70))
        sky.sun_rotation = self.rng.uniform(0, 6.28)
        sky.sun_size = math.radians(self.rng.uniform(0.5, 4))
        sky.sun_intensity = self.rng.uniform(0.2, 1)
        sky.dust_density = self.rng.uniform(0, 5)
        tree.links.new(sky.outputs["Color"], background.inputs["Color"])
        return sky

    def hdri_sky(self, strength, names=None):
        files = hdris()
        self.hdri = self.rng.choice(names or list(files))
        tree, background = self.world(strength)
        image = tree.nodes.new("ShaderNodeTexEnvironment")
        image.image = bpy.data.images.load(str(files[self.hdri]))
        mapping = tree.nodes.new("ShaderNodeMapping")
        mapping.inputs["Rotation"].default_value[2] = self.rng.uniform(0, 6.28)
        source = tree.nodes.new("ShaderNodeTexCoord")
        tree.links.new(source.outputs["Generated"], mapping.inputs["Vector"])
        tree.links.new(mapping.outputs["Vector"], image.inputs["Vector"])
        tree.links.new(image.outputs["Color"], background.inputs["Color"])

    def daylight(self):
        if self.rng.random() < 0.6:
            self.nishita_sky(1)
        else:
            self.hdri_sky(1, ("city", "courtyard", "forest", "sunrise", "sunset"))

    def camera(self, location, target, lens_mm, blur=0.25):
        """Adds the camera; `blur` is the share of views with a depth of field."""
        data = bpy.data.cameras.new("camera")
        data.lens = lens_mm
        data.clip_start, data.clip_end = 0.001, 1000
        camera = bpy.data.objects.new("camera", data)
        camera.matrix_world = towards(location, target)
        bpy.context.collection.objects.link(camera)
        bpy.context.scene.camera = camera
        if self.rng.random() < blur:
            distance = (Vector(target) - Vector(location)).length
            data.dof.use_dof = True
            data.dof.focus_distance = distance * self.rng.uniform(0.6, 1.1)
            # Points at infinity are blurred over up to some 3 % of the picture's width.
            diameter_m = self.rng.uniform(0.005, 0.03) * data.dof.focus_distance * 36 / lens_mm
            data.dof.aperture_fstop = lens_mm / 1000 / diameter_m

    def place(self, model, location, angle):
        root = model.load(self.folder)
        root.matrix_world = Matrix.Translation(location) @ Matrix.Rotation(angle, 4, "Z")
        bpy.context.view_layer.update()
        materials.refinish(root.children, self.rng)
        self.used.append(model)
        self.movable.append(root)
        return root

    def shape(self, location, size_m, name=None, material=None):
        """Adds a shape that stands on `location`."""
        rng = self.rng
        shape = shapes.mesh(rng, name or rng.choice(list(shapes.MESH)), size_m)
        shape.location = location
        shape.rotation_euler[2] = rng.uniform(0, 6.28)
        if material is None:
            make = rng.choices(("surface", "metal", "glass", "glowing", "cloud"), (60, 20, 10, 6, 4))[0]
            if make == "surface":
                scale_m, self.scale_m = self.scale_m, max(size_m, 0.02)
                material = self.surface(plain=0.2)
                self.scale_m = scale_m
            elif make == "glowing":
                material = self.glowing(rng.uniform(0.5, 4))
            elif make == "cloud":
                material = materials.haze(rng, rng.uniform(2, 6) / size_m)
            else:
                material = getattr(materials, make)(rng)
        shape.data.materials.clear()
        shape.data.materials.append(material)
        self.movable.append(shape)
        return shape

    def tree(self, location, height_m):
        trunk, leaves = shapes.tree(self.rng, height_m)
        trunk.matrix_world = Matrix.Translation(location) @ trunk.matrix_world
        scale_m, self.scale_m = self.scale_m, 0.3 * height_m
        trunk.data.materials.append(self.surface(plain=0.1, hue=0.07))
        if leaves:
            leaves.data.materials.append(self.surface(plain=0.3, hue=self.rng.choice((0.08, 0.2, 0.28, 0.32))))
        self.scale_m = scale_m

    def motion(self, extent_m):
        """Adds motion blur: the camera turns and shifts, or some of the movable objects do."""
        rng, scene = self.rng, bpy.context.scene
        scene.render.use_motion_blur = True
        if rng.random() < 0.4 or not self.movable:
            camera = scene.camera
            shift = Vector([rng.uniform(-0.04, 0.04) * extent_m for _ in range(3)])
            self.animate(camera, shift, rng.uniform(-0.03, 0.03))
        else:
            for moved in rng.sample(self.movable, min(len(self.movable), rng.randint(1, 3))):
                shift = Vector((rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), rng.uniform(0, 0.1))) * extent_m
                self.animate(moved, shift, rng.uniform(-0.5, 0.5))
        scene.frame_set(1)

    def animate(self, moved, shift, turn):
        location, angle = moved.location.copy(), moved.rotation_euler[2]
        for frame, side in ((0, -1), (2, 1)):
            moved.location = location + side * shift
            moved.rotation_euler[2] = angle + side * turn
            moved.keyframe_insert("location", frame=frame)
            moved.keyframe_insert("rotation_euler", frame=frame)
        for curve in moved.animation_data.action.fcurves:
            for point in curve.keyframe_points:
                point.interpolation = "LINEAR"

    def haze(self, low, high, depth):
        """Adds a box of thin fog with the given optical depth along its diagonal."""
        density = depth / (Vector(high) - Vector(low)).length
        self.box(low, high, materials.haze(self.rng, density))

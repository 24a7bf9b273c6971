"""Tests the add-on in a Blender without a window: blender -b --factory-startup -P blender/test_addon.py -- PROGRAM

Exits with the status of the tests, which Blender would not do by itself.
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import traceback
import unittest

import bpy
import numpy

PROGRAM = os.path.abspath(sys.argv[sys.argv.index("--") + 1])
ADDON = pathlib.Path(__file__).parent / "raymeld_fusion.py"
MODULE = "raymeld_fusion"
WIDTH, HEIGHT = 96, 64


def srgb(pixels):
    x = numpy.clip(pixels, 0, 1)
    return numpy.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def pixels_of(path):
    """Returns the pixels of an image file as (height, width, 3), linear."""
    image = bpy.data.images.load(str(path))
    pixels = numpy.array(image.pixels[:]).reshape(image.size[1], image.size[0], image.channels)[..., :3]
    bpy.data.images.remove(image)
    return pixels


def psnr(a, b):
    return -10 * numpy.log10(numpy.mean((srgb(a) - srgb(b)) ** 2))


def settings_of(scene):
    """Returns all settings that the renders change, and more."""
    things = [
        scene.render,
        scene.render.image_settings,
        scene.cycles,
        scene.camera.data,
        scene.view_layers[0],
        scene.view_layers[0].cycles,
    ]
    return {
        (i, p.identifier): repr(getattr(thing, p.identifier))
        for i, thing in enumerate(things)
        for p in thing.bl_rna.properties
        if p.type in ("INT", "FLOAT", "BOOLEAN", "ENUM", "STRING") and not p.is_readonly
    }


class Test(unittest.TestCase):
    def setUp(self):
        bpy.ops.wm.read_factory_settings()
        bpy.ops.preferences.addon_install(filepath=str(ADDON))
        bpy.ops.preferences.addon_enable(module=MODULE)
        self.preferences = bpy.context.preferences.addons[MODULE].preferences
        self.preferences.program = PROGRAM
        self.scene = scene = bpy.context.scene
        scene.render.engine = "CYCLES"
        scene.render.resolution_x, scene.render.resolution_y = 2 * WIDTH, 2 * HEIGHT
        scene.render.resolution_percentage = 50
        bpy.ops.mesh.primitive_plane_add(size=30, location=(0, 0, -1))
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        scene.raymeld.folder = self.folder.name
        scene.raymeld.few = 1

    def test_the_image_is_the_fusion_of_both_renders(self):
        before = settings_of(self.scene)
        self.assertEqual(bpy.ops.render.raymeld(), {"FINISHED"})
        self.assertEqual(settings_of(self.scene), before)
        image = bpy.data.images["Raymeld"]
        self.assertEqual(tuple(image.size), (WIDTH, HEIGHT))
        folder = pathlib.Path(self.folder.name)
        again = folder / "again.exr"
        subprocess.run([PROGRAM, "fuse", "--lrhs", folder / "lrhs.exr", "--hrls", folder / "hrls.exr", "-o", again,
                        "--lrhs-sampling", "centered", "--quality", "balanced"], check=True)
        shown = numpy.array(image.pixels[:]).reshape(HEIGHT, WIDTH, image.channels)[..., :3]
        numpy.testing.assert_array_equal(shown, pixels_of(again))

        # The image is near a render of many samples, and nearer in its place than shifted by a pixel.
        reference = self.render_reference(folder)
        fused = psnr(shown, reference)
        for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            self.assertGreater(fused, psnr(numpy.roll(shown, (dy, dx), (0, 1)), reference))
        self.assertGreater(fused, 26)

        # A second run replaces the image.
        scene = self.scene
        scene.raymeld.scale, scene.raymeld.quality, scene.raymeld.folder = "4", "fast", ""
        self.assertEqual(bpy.ops.render.raymeld(), {"FINISHED"})
        self.assertEqual([i.name for i in bpy.data.images if i.name.startswith("Raymeld")], ["Raymeld"])

    def test_one_render_alone_is_enough(self):
        folder = pathlib.Path(self.folder.name)
        for command, option, kept in (("denoise", "--hrls", "hrls.exr"), ("upscale", "--lrhs", "lrhs.exr")):
            before = settings_of(self.scene)
            self.scene.raymeld.command = command
            self.assertEqual(bpy.ops.render.raymeld(), {"FINISHED"})
            self.assertEqual(settings_of(self.scene), before)
            self.assertEqual({path.name for path in folder.iterdir()}, {kept, "raymeld.exr"})
            again = folder / "again.exr"
            subprocess.run([PROGRAM, command, option, folder / kept, "-o", again], check=True)
            image = bpy.data.images["Raymeld"]
            self.assertEqual(tuple(image.size), (WIDTH, HEIGHT))
            shown = numpy.array(image.pixels[:]).reshape(HEIGHT, WIDTH, image.channels)[..., :3]
            numpy.testing.assert_array_equal(shown, pixels_of(again))
            for path in folder.iterdir():
                path.unlink()

    def render_reference(self, folder):
        scene = self.scene
        scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = 256, False, False
        scene.render.image_settings.file_format = "OPEN_EXR"
        scene.render.image_settings.color_depth = "32"
        scene.render.filepath = str(folder / "reference.exr")
        bpy.ops.render.render(write_still=True)
        return pixels_of(folder / "reference.exr")

    def test_renders_made_by_hand_need_no_option(self):
        """Follows the README's recipe: the same scene at full size and at a quarter of it, by Resolution %."""
        scene, folder = self.scene, pathlib.Path(self.folder.name)
        scene.render.resolution_x, scene.render.resolution_y = 4 * WIDTH, 4 * HEIGHT
        scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = False, False
        layer = bpy.context.view_layer
        layer.cycles.denoising_store_passes = True
        for light in ("diffuse", "glossy"):
            for kind in ("direct", "indirect", "color"):
                setattr(layer, f"use_pass_{light}_{kind}", True)
        scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
        for name, percentage, samples in (("high", 100, 2), ("low", 25, 32)):
            scene.render.resolution_percentage, scene.cycles.samples = percentage, samples
            scene.render.filepath = str(folder / f"{name}.exr")
            bpy.ops.render.render(write_still=True)
        command = [PROGRAM, "fuse", "--lrhs", folder / "low.exr", "--hrls", folder / "high.exr", "-o"]
        subprocess.run([*command, folder / "plain.exr"], check=True)
        for sampling, same in (("centered", True), ("nearest", False)):
            subprocess.run([*command, folder / f"{sampling}.exr", "--lrhs-sampling", sampling], check=True)
            said = numpy.array_equal(pixels_of(folder / "plain.exr"), pixels_of(folder / f"{sampling}.exr"))
            self.assertEqual(said, same, sampling)

    def test_what_is_animated(self):
        scene = self.scene
        for frame, samples in ((1, 40), (11, 60)):
            scene.cycles.samples = samples
            scene.cycles.keyframe_insert("samples", frame=frame)
        scene.cycles.driver_add("seed").driver.expression = "frame"
        scene.frame_set(6)
        before = settings_of(scene)
        self.assertEqual((scene.cycles.samples, scene.cycles.seed), (50, 6))
        self.assertEqual(bpy.ops.render.raymeld(), {"FINISHED"})
        self.assertEqual(settings_of(scene), before)
        self.assertFalse(any(curve.mute for curve in scene.animation_data.action.fcurves))
        animated = numpy.array(bpy.data.images["Raymeld"].pixels[:])

        # The samples and seeds were those of the renders of a scene that is not animated.
        scene.animation_data_clear()
        scene.cycles.seed = 6
        self.assertEqual(bpy.ops.render.raymeld(), {"FINISHED"})
        numpy.testing.assert_array_equal(animated, numpy.array(bpy.data.images["Raymeld"].pixels[:]))

    def test_an_animation_is_joined_in_time(self):
        scene, folder = self.scene, pathlib.Path(self.folder.name)
        scene.raymeld.scale, scene.raymeld.quality = "4", "fast"
        scene.frame_start, scene.frame_end = 1, 5
        scene.frame_set(2)
        bpy.data.objects["Light"].data.shadow_soft_size = 2
        camera = scene.camera
        for frame in (1, 5):
            camera.location.z += 0.1 * frame
            camera.keyframe_insert("location", frame=frame)
        before = settings_of(scene)
        self.assertEqual(bpy.ops.render.raymeld_animation(), {"FINISHED"})
        self.assertEqual((settings_of(scene), scene.frame_current), (before, 2))
        names = {f"{kind}.000{frame}.exr" for kind in ("lrhs", "hrls", "raymeld") for frame in range(1, 6)}
        self.assertEqual({path.name for path in folder.iterdir()}, names)
        inputs = ["--lrhs", folder / "lrhs.####.exr", "--hrls", folder / "hrls.####.exr", "--frames", "1-5"]
        again = folder / "again.####.exr"
        subprocess.run([PROGRAM, "fuse", *inputs, "-o", again, "--quality", "fast", "--temporal"], check=True)
        joined, same = pixels_of(folder / "raymeld.0005.exr"), pixels_of(folder / "again.0005.exr")
        numpy.testing.assert_array_equal(joined, same)
        subprocess.run([PROGRAM, "fuse", *inputs, "-o", again, "--quality", "fast"], check=True)
        scene.frame_set(5)
        reference = self.render_reference(folder)
        alone = psnr(pixels_of(folder / "again.0005.exr"), reference)
        self.assertGreater(psnr(joined, reference), alone + 0.5)

    def test_what_an_animation_needs_is_said(self):
        scene = self.scene
        for thing, name, value, text in (
            (scene.raymeld, "folder", "", "needs a folder"),
            (scene.render, "use_motion_blur", True, "no motion vectors with Motion Blur"),
            (scene, "frame_step", 2, "set Step to 1"),
        ):
            before = getattr(thing, name)
            setattr(thing, name, value)
            with self.assertRaisesRegex(RuntimeError, text):
                bpy.ops.render.raymeld_animation()
            setattr(thing, name, before)

    def expect_failure(self, text):
        before = settings_of(self.scene)
        with self.assertRaisesRegex(RuntimeError, text):
            bpy.ops.render.raymeld()
        self.assertEqual(settings_of(self.scene), before)
        self.assertNotIn("Raymeld", bpy.data.images)

    def test_what_is_wrong_is_said(self):
        self.scene.render.resolution_x += 2
        self.expect_failure("97 x 64 pixels is not a multiple of the scale, 2")
        self.scene.render.resolution_x -= 2
        self.preferences.program = "/no/such/program"
        self.expect_failure("no program /no/such/program")
        self.preferences.program = PROGRAM
        self.scene.raymeld.folder = "/dev/null/x"
        self.expect_failure("/dev/null")
        self.scene.render.engine = "BLENDER_EEVEE"
        self.expect_failure("not Cycles")


with tempfile.TemporaryDirectory() as scripts:
    # Add-ons are installed into this folder.
    bpy.utils.user_resource = lambda kind, path="", create=False: os.path.join(scripts, path)
    sys.path.insert(0, os.path.join(scripts, "addons"))
    os.makedirs(os.path.join(scripts, "addons"))
    try:
        passed = unittest.main(argv=[sys.argv[0]], exit=False).result.wasSuccessful()
    except BaseException:
        traceback.print_exc()
        passed = False
sys.stdout.flush()
os._exit(0 if passed else 1)

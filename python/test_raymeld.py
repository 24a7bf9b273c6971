"""Tests that the Python module gives what the program gives: test_raymeld.py PROGRAM MODEL FOLDER_FOR_FILES"""

import os
import pathlib
import subprocess
import sys
import threading
import time
import unittest

import numpy
import OpenImageIO as oiio

import raymeld

PROGRAM, MODEL, FOLDER = sys.argv[1:4]
HEIGHT, WIDTH = 6, 8


def image(seed, height, width):
    return numpy.random.default_rng(seed).random((height, width, 3), dtype=numpy.float32)


def write(name, channels, pixels):
    path = os.path.join(FOLDER, name)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.channelnames = channels
    output = oiio.ImageOutput.create(path)
    assert output.open(path, spec) and output.write_image(numpy.ascontiguousarray(pixels)) and output.close()
    return path


class Test(unittest.TestCase):
    def setUp(self):
        self.model = raymeld.Model(MODEL)
        scale = self.model.scale
        self.lrhs = image(1, HEIGHT, WIDTH)
        self.hrls = {name: image(i, scale * HEIGHT, scale * WIDTH) for i, name in enumerate(self.model.layers, 2)}

    def fusion(self, **options):
        return raymeld.Fusion(self.model, HEIGHT, WIDTH, **options)

    def test_gives_what_the_program_gives(self):
        self.assertEqual(self.model.layers[0], "color")
        fusion = self.fusion(precision="fp32", exposure=1)
        fused = fusion.fuse(self.lrhs, self.hrls)
        self.assertEqual((fused.shape, fused.dtype), (self.hrls["color"].shape, numpy.float32))
        rgb = ["R", "G", "B"]
        low = write("low.exr", rgb, self.lrhs)
        names = rgb + [f"{layer}.{c}" for layer in self.model.layers[1:] for c in rgb]
        high = write("high.exr", names, numpy.concatenate([self.hrls[name] for name in self.model.layers], axis=2))
        maps = [
            a for layer in self.model.layers[1:] for a in ("--map", f"{layer}=" + ",".join(f"{layer}.{c}" for c in rgb))
        ]
        out = os.path.join(FOLDER, "fused.exr")
        subprocess.run([PROGRAM, "fuse", "--lrhs", low, "--hrls", high, "-o", out, "--model", MODEL,
                        "--precision", "fp32", "--input-exposure", "1", "--lrhs-sampling", "nearest",
                        "--output-type", "float", *maps], check=True)
        expected = oiio.ImageBuf(out).get_pixels(oiio.FLOAT)
        numpy.testing.assert_array_equal(fused, expected)
        self.assertEqual(fusion.precision, "fp32")
        self.assertGreater(fusion.memory_bytes, 0)

    def test_any_array_of_numbers(self):
        fusion = self.fusion()
        expected = fusion.fuse(self.lrhs, self.hrls)
        strided = {name: numpy.asfortranarray(layer.astype(numpy.float64)) for name, layer in self.hrls.items()}
        numpy.testing.assert_array_equal(fusion.fuse(self.lrhs[:, ::-1][:, ::-1], strided), expected)

    def test_status(self):
        fusion = self.fusion(skip_unchanged=True, precision="fp32")
        fusion.fuse(self.lrhs, self.hrls)
        self.assertEqual(fusion.status["skipped_share"], 0)
        fusion.fuse(self.lrhs, self.hrls)
        self.assertEqual(fusion.status, {"saturated": 0, "redone_tiles": 0, "skipped_share": 1})

    def test_stock_models_by_name(self):
        self.assertIn("x4-fast", raymeld.list_models())
        self.assertEqual(raymeld.Model("x4-fast").scale, 4)
        with self.assertRaisesRegex(raymeld.Error, "no model 'x3-fast'.* x4-fast"):
            raymeld.Model("x3-fast")

    def test_paths_and_what_things_are(self):
        model = raymeld.Model(pathlib.Path(MODEL))
        self.assertEqual(model.layers, self.model.layers)
        self.assertRegex(repr(model), f"<raymeld.Model '{model.name}', scale {model.scale}, reads color, ")
        self.assertRegex(repr(self.fusion(precision="fp32")),
                         f"<raymeld.Fusion of '{model.name}', LRHS of 6 x 8 pixels .*, fp32>")

    def test_devices_are_chosen_by_name_or_index(self):
        names = raymeld.devices()
        self.assertGreater(len(names), 0)
        expected = self.fusion(device="0").fuse(self.lrhs, self.hrls)
        if len(set(names)) == len(names):
            numpy.testing.assert_array_equal(self.fusion(device=names[0]).fuse(self.lrhs, self.hrls), expected)

    def test_variance_is_computed_unless_it_is_given(self):
        model = raymeld.Model(pathlib.Path(__file__).parent.parent / "tests" / "golden" / "tiny-x2.safetensors")
        self.assertIn("variance", model.layers)
        fusion = raymeld.Fusion(model, HEIGHT, WIDTH, precision="fp32")
        self.assertNotIn("variance", fusion.layers)
        hrls = {name: image(i, 2 * HEIGHT, 2 * WIDTH) for i, name in enumerate(fusion.layers)}
        padded = numpy.pad(hrls["color"].astype(numpy.float64), ((1, 1), (1, 1), (0, 0)), "edge")
        around = numpy.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(0, 1))
        first = fusion.fuse(self.lrhs, hrls)
        second = fusion.fuse(self.lrhs, {**hrls, "variance": around.var(axis=(3, 4))})
        other = fusion.fuse(self.lrhs, {**hrls, "variance": numpy.zeros_like(hrls["color"])})
        self.assertGreater(abs(second - other).sum(), 0)
        self.assertLess(abs(first - second).sum(), 1e-3 * abs(second - other).sum())
        numpy.testing.assert_array_equal(fusion.fuse(self.lrhs, hrls), first)

    def test_what_is_wrong_is_named(self):
        with self.assertRaisesRegex(raymeld.Error, "none.safetensors"):
            raymeld.Model("none.safetensors")
        with self.assertRaisesRegex(raymeld.Error, "no such device"):
            self.fusion(device="no such device")
        with self.assertRaisesRegex(ValueError, "precision is 'half', expected one of auto, fp32, fp16"):
            self.fusion(precision="half")
        with self.assertRaisesRegex(raymeld.Error, "cannot do without layer 'color'"):
            self.fusion(absent_layers=["color"])
        for height in (-1, 0, 65537, 4_000_000_000):
            with self.assertRaisesRegex(ValueError, f"height is {height}, expected 1 to 65536"):
                raymeld.Fusion(self.model, height, WIDTH)
        fusion = self.fusion()
        with self.assertRaisesRegex(ValueError, r"lrhs has the shape \(8, 6, 3\), expected \(6, 8, 3\)"):
            fusion.fuse(self.lrhs.transpose(1, 0, 2), self.hrls)
        with self.assertRaisesRegex(ValueError, "'albedo'.* has the shape"):
            fusion.fuse(self.lrhs, {**self.hrls, "albedo": self.lrhs})
        del self.hrls["albedo"]
        with self.assertRaisesRegex(KeyError, "hrls has no 'albedo'"):
            fusion.fuse(self.lrhs, self.hrls)

    def test_a_model_of_scale_1_reads_hrls_alone(self):
        model = raymeld.Model(os.path.join(os.path.dirname(MODEL), "pyramid-x1.safetensors"))
        self.assertEqual(model.scale, 1)
        hrls = {name: image(i, 20, 12) for i, name in enumerate(model.layers)}
        fusion = raymeld.Fusion(model, 20, 12)
        denoised = fusion.fuse(None, hrls)
        self.assertEqual(denoised.shape, (20, 12, 3))
        self.assertTrue(numpy.isfinite(denoised).all())
        darker = fusion.fuse(None, {name: x * (0.5 if name == "color" else 1) for name, x in hrls.items()})
        self.assertLess(darker.mean(), 0.9 * denoised.mean())
        with self.assertRaisesRegex(raymeld.Error, "lrhs, which must be NULL"):
            fusion.fuse(hrls["color"], hrls)
        with self.assertRaisesRegex(raymeld.Error, "lrhs is NULL"):
            self.fusion().fuse(None, self.hrls)

    def test_a_model_that_upscales_reads_lrhs_alone(self):
        model = raymeld.Model(os.path.join(os.path.dirname(MODEL), "edsr-x4.safetensors"))
        self.assertEqual(model.layers, [])
        upscaled = raymeld.Fusion(model, HEIGHT, WIDTH).fuse(self.lrhs, {})
        self.assertEqual(upscaled.shape, (4 * HEIGHT, 4 * WIDTH, 3))
        self.assertTrue(numpy.isfinite(upscaled).all())

    def test_temporal_frames_join_the_ones_before(self):
        model = raymeld.Model(os.path.join(os.path.dirname(MODEL), "pyramid-x2.safetensors"))
        fusion = raymeld.Fusion(model, HEIGHT, WIDTH, sampling="centered", temporal=True)
        hrls = {name: image(i, 2 * HEIGHT, 2 * WIDTH) for i, name in enumerate(fusion.layers)}
        motion = numpy.zeros((2 * HEIGHT, 2 * WIDTH, 2), numpy.float32)
        first, second = (fusion.fuse(self.lrhs, hrls, motion) for _ in range(2))
        self.assertGreater(abs(second - first).max(), 0)
        fusion.reset_history()
        numpy.testing.assert_array_equal(fusion.fuse(self.lrhs, hrls, motion=motion), first)
        saved = fusion.save_history()
        third = fusion.fuse(self.lrhs, hrls, motion)
        other = raymeld.Fusion(model, HEIGHT, WIDTH, sampling="centered", temporal=True)
        other.load_history(saved)
        numpy.testing.assert_array_equal(other.fuse(self.lrhs, hrls, motion), third)
        with self.assertRaisesRegex(raymeld.Error, "bytes, expected"):
            other.load_history(saved[:-1])
        deep = raymeld.Fusion(model, HEIGHT, WIDTH, sampling="centered", temporal=True, motion_depth=True)
        depths = [numpy.concatenate([motion, numpy.full_like(motion, depth)], -1) for depth in (1, 1, 9)]
        same, near, far = (deep.fuse(self.lrhs, hrls, with_depth) for with_depth in depths)
        numpy.testing.assert_array_equal(same, first)
        numpy.testing.assert_array_equal(near, second)
        self.assertFalse((far == fusion.fuse(self.lrhs, hrls, motion)).all())
        nowhere = numpy.full_like(motion, numpy.nan)
        numpy.testing.assert_array_equal(fusion.fuse(self.lrhs, hrls, nowhere), first)
        with self.assertRaisesRegex(ValueError, r"motion has the shape .*, expected \(12, 16, 2\)"):
            fusion.fuse(self.lrhs, hrls, motion[..., :1])
        with self.assertRaisesRegex(ValueError, "variance, which a temporal fusion computes"):
            fusion.fuse(self.lrhs, {**hrls, "variance": hrls["color"]}, motion)
        with self.assertRaisesRegex(raymeld.Error, "motion is NULL"):
            fusion.fuse(self.lrhs, hrls)
        with self.assertRaisesRegex(raymeld.Error, "not temporal"):
            raymeld.Fusion(model, HEIGHT, WIDTH).fuse(self.lrhs, hrls, motion)

    def test_other_threads_run_meanwhile(self):
        height, width = 48, 64
        fusion = raymeld.Fusion(self.model, height, width, kernels="direct")
        lrhs = image(1, height, width)
        hrls = {name: image(2, fusion.scale * height, fusion.scale * width) for name in fusion.layers}
        fusion.fuse(lrhs, hrls)  # drivers compile in the first call
        ticks, going = [], True

        def tick():
            while going:
                ticks.append(time.monotonic())
                time.sleep(0.001)

        thread = threading.Thread(target=tick)
        thread.start()
        begin = time.monotonic()
        expected = fusion.fuse(lrhs, hrls)
        end = time.monotonic()
        others = [None, None]

        def fuse(i):
            others[i] = fusion.fuse(lrhs, hrls)

        threads = [threading.Thread(target=fuse, args=(i,)) for i in range(2)]
        for other in threads:
            other.start()
        for other in threads:
            other.join()
        going = False
        thread.join()
        self.assertGreater(sum(begin < t < end for t in ticks), 5)
        for other in others:
            numpy.testing.assert_array_equal(other, expected)


unittest.main(argv=sys.argv[:1])

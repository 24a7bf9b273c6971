#!/usr/bin/python3
"""Tests the evaluation, and given both arguments also the program on a made-up view: self_test.py [PROGRAM [MODEL]]."""

import json
import math
import os
import pathlib
import struct
import sys
import tempfile
import unittest
from unittest import mock

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

import numpy
import torch

import model as networks
import safetensors
from evaluation import agreement, cost, nfor, numerics, numerics_pages, oidn, tables, test_set
from evaluation.baselines import bicubic, window
from evaluation.filters import FILTERS, TUNED
from evaluation.changes import CHANGES
from evaluation.images import Exr, psnr, read, relmse
from evaluation.input_classes import CLASSES, crop, pair
from evaluation.jobs import Job, Model, Score, Store
from evaluation.kernel_choices import WINOGRAD, Choice

SIZE = 64
LAYERS = ("Combined", "DiffDir", "DiffInd", "DiffCol", "GlossDir", "GlossInd", "GlossCol", "Denoising Albedo")
DATA = pathlib.Path(__file__).resolve().parent.parent.parent / "data"
PROGRAM = MODEL = None


def scene(noise, seed):
    """Makes a lit ramp over two albedos: (color, albedo, normal), [SIZE, SIZE, 3] each."""
    rng = numpy.random.default_rng(seed)
    ramp = numpy.linspace(0.2, 1, SIZE, dtype="float32")[:, None, None] * numpy.ones((1, SIZE, 3), "float32")
    albedo = numpy.where(numpy.arange(SIZE) < SIZE // 2, 0.2, 0.8).astype("float32")[None, :, None] * ramp**0
    normal = numpy.float32((0, 0, 1)) * ramp**0
    return (albedo * ramp * rng.gamma(1 / noise, noise, ramp.shape)).astype("float32"), albedo, normal


def exr(noise, seed):
    color, albedo, normal = scene(noise, seed)
    parts = [color, color / albedo, 0 * color, albedo, 0 * color, 0 * color, 0 * color, albedo, normal]
    names = [f"ViewLayer.{layer}.{c}" for layer in LAYERS for c in "RGB"]
    names += [f"ViewLayer.Denoising Normal.{c}" for c in "XYZ"] + ["ViewLayer.Combined.A"]
    return Exr(names, numpy.concatenate([*parts, color[..., :1] ** 0], axis=-1))


def cells(pixels, scale):
    """Returns the means of the cells of scale x scale pixels."""
    height, width = pixels.shape[:2]
    return pixels.reshape(height // scale, scale, width // scale, scale, -1).mean((1, 3))


def write_view(folder):
    folder.mkdir()
    names = {test_set.render(n): 1 / n for n in test_set.PLAIN} | dict.fromkeys(test_set.HALVES, 1e-3)
    for seed, (name, noise) in enumerate(names.items()):
        exr(noise, seed).write(folder / name)
    low = exr(1 / 16, 100)
    Exr(low.channels, low.pixels[::4, ::4]).write(folder / test_set.decimated(4, 16))
    Exr(low.channels, cells(low.pixels, 4)).write(folder / test_set.lrhs(4, 16))
    times = {n: 0.5 + 0.25 * n for n in test_set.PLAIN}
    files = {test_set.render(n): {"spp": n, "seconds": (2 if n == 2 else 1) * s} for n, s in times.items()}
    files |= {name: {"spp": 16} for name in (test_set.decimated(4, 16), test_set.lrhs(4, 16))}
    (folder / "view.json").write_text(json.dumps({"version": 1, "kind": "ramp", "files": files}))
    return test_set.View(folder)


class Measures(unittest.TestCase):
    def test_error_of_a_known_size(self):
        reference = numpy.full((4, 4, 3), 0.5, "float32")
        self.assertAlmostEqual(relmse(reference + 0.1, reference), 0.5 * 0.01 / 0.26, 6)
        self.assertAlmostEqual(psnr(0 * reference, reference**0), 0, 5)

    def test_what_is_brighter_than_the_clip_is_equal(self):
        bright = numpy.full((4, 4, 3), 200, "float32")
        self.assertEqual(relmse(bright, bright * 3), 0)


class Baselines(unittest.TestCase):
    def test_bicubic_keeps_samples_and_ramps(self):
        full = numpy.linspace(0, 1, SIZE)[:, None, None] * numpy.ones((1, SIZE, 3))
        up = bicubic(full[::4, ::4], 4)
        numpy.testing.assert_allclose(up[::4, ::4], full[::4, ::4], atol=1e-6)
        numpy.testing.assert_allclose(up[4:-8], full[4:-8], atol=1e-6)
        centered = bicubic(cells(full, 4), 4, 1.5)
        numpy.testing.assert_allclose(centered[8:-8, 8:-8], full[8:-8, 8:-8], atol=1e-6)

    def test_filters_remove_noise_and_keep_edges(self):
        truth = numpy.prod(numpy.broadcast_arrays(*scene(1e-9, 0)[:2]), axis=0) / scene(1e-9, 0)[1]
        noisy, albedo, normal = scene(0.5, 1)
        for name, share in (("atrous", 1 / 10), ("svgf", 1 / 20), ("nfor", 1 / 20)):
            filtered = FILTERS[name](noisy, albedo, normal, TUNED[name][2])
            self.assertLess(relmse(filtered, truth), relmse(noisy, truth) * share, name)

    def test_filters_keep_what_is_flat(self):
        flat = numpy.full((8, 8, 3), 0.3, "float32")
        for name, denoise in FILTERS.items():
            numpy.testing.assert_allclose(denoise(flat, flat, flat, TUNED[name][8]), flat, rtol=1e-5, err_msg=name)

    def test_regressions_are_weighted_least_squares(self):
        rng, height, width, radius = numpy.random.default_rng(1), 4, 5, 1
        x, features = rng.random((height, width, 3)), rng.normal(size=(height, width, 6))
        weights = rng.random((9, height, width))
        total, sums = numpy.zeros((height, width, 1)), numpy.zeros((height, width, 3))
        for y, u in numpy.ndindex(height, width):
            near = [(y + dy, u + dx, i) for i, (dy, dx) in enumerate(window(radius))]
            near = [(v, w, weights[i, y, u]) for v, w, i in near if 0 <= v < height and 0 <= w < width]
            seen = [[*(features[v, w] - features[y, u]), (v - y) / radius, (w - u) / radius, 1] for v, w, _ in near]
            a, weight = numpy.array(seen), numpy.array([weight for _, _, weight in near])[:, None]
            ridge = nfor.RIDGE * weight.sum() * numpy.diag([1] * 8 + [0])
            fit = numpy.linalg.solve(a.T @ (weight * a) + ridge, a.T @ (weight * [x[v, w] for v, w, _ in near]))
            for (v, w, share), value in zip(near, a @ fit):
                total[v, w] += share
                sums[v, w] += share * value
        numpy.testing.assert_allclose(nfor.regression(x, features, weights), sums / total, rtol=1e-3, atol=1e-3)

    def test_regressions_keep_what_features_explain(self):
        rng = numpy.random.default_rng(2)
        features, slopes = rng.normal(size=(8, 8, 6)), rng.normal(size=(6, 3))
        x = features @ slopes + 5
        kept = nfor.regression(x, features, rng.random((49, 8, 8)))
        self.assertLess(numpy.abs(kept - x).mean(), 0.01 * numpy.abs(x - 5).mean())


def oidn_widths():
    """Returns (inputs, outputs) of the network's convolutions."""
    widths = {"enc_conv0": (9, 4), "enc_conv5a": (4, 4), "enc_conv5b": (4, 4), "dec_conv0": (4, 3)}
    widths |= {f"enc_conv{i}": (4, 4) for i in range(1, 5)} | {f"dec_conv{i}b": (4, 4) for i in range(1, 5)}
    return widths | {f"dec_conv{i}a": (13 if i == 1 else 8, 4) for i in range(1, 5)}


class OpenImageDenoise(unittest.TestCase):
    def test_the_curve_is_continuous_and_inverted(self):
        for end in (oidn.LINEAR_END, oidn.POWER_END):
            below, above = oidn.curve(torch.tensor([end * 0.9999, end * 1.0001], dtype=torch.double))
            self.assertLess(abs(float(above - below)), 1e-3 * float(below))
        radiance = torch.logspace(-8, 4.8, 200, dtype=torch.double)
        numpy.testing.assert_allclose(oidn.inverse_curve(oidn.curve(radiance)), radiance, rtol=1e-4)

    def test_the_exposure_brings_a_flat_image_to_the_key(self):
        self.assertAlmostEqual(oidn.exposure(torch.full((40, 40, 3), 3.0)), 0.06, 5)
        self.assertEqual(oidn.exposure(torch.zeros(40, 40, 3)), 1)

    def test_tensors_are_read_as_written(self):
        one, two = numpy.arange(6, dtype="<f2").reshape(2, 3), numpy.float32([7, 8])
        tensors = one.tobytes() + two.tobytes()
        table = struct.pack("<IH3sB2I2scQ", 2, 3, b"one", 2, 2, 3, b"oi", b"h", 12)
        table += struct.pack("<H3sBIccQ", 3, b"two", 1, 2, b"x", b"f", 24)
        read = oidn.read(struct.pack("<HBBQ", 0x41D7, 2, 0, 32) + tensors + table)
        numpy.testing.assert_array_equal(read["one"], one)
        numpy.testing.assert_array_equal(read["two"], two)
        with self.assertRaisesRegex(ValueError, "no .tza file"):
            oidn.read(bytes(12))

    def test_a_network_that_passes_the_color_through_changes_nothing(self):
        tensors = {}
        for name, (inputs, outputs) in oidn_widths().items():
            tensors[f"{name}.weight"] = torch.zeros(outputs, inputs, 3, 3)
            tensors[f"{name}.bias"] = torch.zeros(outputs)
        # The image comes after the upsampled features.
        for name, first in (("dec_conv1a", 4), ("dec_conv1b", 0), ("dec_conv0", 0)):
            for channel in range(3):
                tensors[f"{name}.weight"][channel, first + channel, 1, 1] = 1
        image = scene(0.5, 1)
        numpy.testing.assert_allclose(oidn.denoise(tensors, *image), image[0], rtol=1e-3)


class EqualCost(unittest.TestCase):
    def test_interpolates_and_extrapolates(self):
        errors = 1 / numpy.array(tables.RENDERS_SPP, float)
        self.assertAlmostEqual(tables.equal_spp(errors, 1 / 5.0)[0], 5)
        self.assertFalse(tables.equal_spp(errors, 1 / 5.0)[1])
        spp, beyond = tables.equal_spp(errors, 1 / 128)
        self.assertAlmostEqual(spp, 128)
        self.assertTrue(beyond)


class Tables(unittest.TestCase):
    def test_fill_a_page_between_marks(self):
        sheet = tables.Sheet("main", ["", "a"], [["x", Score(30, 0.01, 1)], ["y", None]])
        page = tables.insert("before\n<!-- begin main -->\nold\n<!-- end -->\nafter", [sheet])
        self.assertIn("| x | 30.00 / 0.0100 |\n| y |  |\n<!-- end -->\nafter", page)
        self.assertNotIn("old", page)


class Views(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.path = pathlib.Path(self.folder.name)
        self.view = write_view(self.path / "view-00001")

    def test_files_are_read_as_written(self):
        path = self.view.folder / test_set.render(1)
        written = exr(1.0, 0)
        numpy.testing.assert_array_equal(read(path), written.pixels[..., :3])
        self.assertEqual(sorted(Exr.read(path).channels), sorted(written.channels))

    def test_times_are_those_of_an_idle_machine(self):
        self.assertAlmostEqual(self.view.seconds(2), 1.0, 2)
        self.assertAlmostEqual(self.view.seconds(16, 4), 4.5 / 16, 2)

    def test_a_view_that_is_rendered_again_keeps_its_scores(self):
        job = Job("svgf", hrls=test_set.render(2))
        before = job.key(self.view)
        exr(0.5, 1).write(self.view.folder / job.hrls)
        self.assertEqual(job.key(test_set.View(self.view.folder)), before)
        test_set.digest.cache_clear()
        exr(0.5, 1).write(self.view.folder / test_set.HALVES[0])
        self.assertNotEqual(job.key(test_set.View(self.view.folder)), before)

    def test_a_lead_is_over_the_best_rival(self):
        model = Model(pathlib.Path("x4.safetensors"), "", 4)
        store, filtered = Store(self.path / "results.csv", None), Score(30, 0.02, 1)
        for method, score in (("render", Score(20, 0.1, 1)), ("atrous", filtered), ("bicubic", Score(25, 0.01, 1))):
            store.scores[tables.rival(method, 4, (16, 1), 0).key(self.view)] = score
        store.scores[tables.base(model).key(self.view)] = Score(33, 0.005, 1)
        self.assertEqual(tables.first_lead(model, self.view, store), (3, 2))
        self.assertIsNone(tables.first_lead(model, self.view, store, ["svgf"]))

    def test_a_filter_is_timed_by_its_render(self):
        """The view's renders take 0.5 + 0.25 spp seconds."""
        store = Store(self.path / "results.csv", None)
        for spp in test_set.AVERAGES:
            score = Score(30 + numpy.log2(0.5 + 0.25 * spp), 0.01, 9)
            store.scores[Job("svgf", hrls=test_set.render(spp)).key(self.view)] = score
        for seconds in (0.8, 1.2, 2, 5):
            self.assertAlmostEqual(tables.filtered_psnr(self.view, store, seconds), 30 + numpy.log2(seconds), 1)

    def test_x4_models_are_measured_with_pairs_of_x8_too(self):
        model = Model(pathlib.Path("x4.safetensors"), "", 4)
        labels = [tables.label(*one[:3]) for one in tables.pairings([model])]
        self.assertEqual(labels[::5], ["x4, 16-1", "x4, x8, 64-7"])

    def test_costs_are_medians_of_turns(self):
        models = [Model(pathlib.Path(f"{name}.safetensors"), "", scale, *reads) for name, scale, *reads in (
            ("denoise", 1, False, True), ("fuse", 4, True, True), ("upscale", 2, True, False))]
        named = {label: job for label, job in cost.jobs(models)}
        self.assertEqual((named["denoise"].lrhs, named["denoise"].hrls), ("", test_set.render(2)))
        self.assertEqual((named["fuse"].lrhs, named["fuse"].hrls), (test_set.lrhs(4, 16), test_set.render(1)))
        self.assertEqual((named["upscale"].lrhs, named["upscale"].hrls), (test_set.lrhs(2, 4), ""))
        seconds = {job: [3.0 * i, i, 2.0 * i] for i, job in enumerate(named.values(), 1)}
        with mock.patch.object(Job, "image", lambda job, view, program: (None, seconds[job].pop(0))):
            sheet = cost.sheet(models, None, None)
        self.assertEqual(sheet.rows[0][1:], ["2.00", "1.0"])
        self.assertEqual(sheet.rows[-1], ["upscale", "12.00", "6.0"])

    def test_all_renders_together_are_worth_their_samples(self):
        last, together = (job.image(self.view, None)[0] for job in tables.RENDERS[-2:])
        reference = self.view.reference()
        spp = test_set.ALL_PLAIN / test_set.PLAIN[-1]
        self.assertAlmostEqual(numpy.mean((last - reference) ** 2) / numpy.mean((together - reference) ** 2), spp, 1)

    def test_scores_are_kept(self):
        path, job = self.path / "results.csv", Job("render", hrls=test_set.render(4))
        score = Store(path, None).measure(job, self.view)
        self.assertAlmostEqual(Store(path, None).get(job, self.view).psnr, score.psnr, 3)
        self.assertIsNone(Store(path, None).get(Job("render", hrls=test_set.render(8)), self.view))

    def test_means_are_only_of_all_views(self):
        store, job = Store(self.path / "results.csv", None), Job("half")
        self.assertIsNone(tables.mean(job, [self.view], store))
        store.measure(job, self.view)
        self.assertGreater(tables.mean(job, [self.view], store).psnr, 30)

    def test_changes_touch_what_they_name(self):
        before = exr(1.0, 0)
        lit = {"Combined", "DiffDir"}
        expected = {
            "exposure +4": lit,
            "fireflies": lit,
            "rgb": {"DiffDir", "DiffCol", "Denoising Albedo", "Denoising Normal"},
            "no-hrls": {"Combined", "DiffDir", "DiffCol", "Denoising Albedo", "Denoising Normal"},
            "alpha": {"Combined"},
        }
        for name, layers in expected.items():
            after = exr(1.0, 0)
            CHANGES[name].apply(exr(1.0, 1), after, 4)
            differ = (after.pixels != before.pixels).any((0, 1))
            touched = {channel.split(".")[1] for channel, differs in zip(before.channels, differ) if differs}
            self.assertEqual(touched, layers, name)

    def test_an_averaged_lrhs_has_means_of_pixels(self):
        lrhs = exr(1.0, 0)
        before = lrhs.pixels.copy()
        CHANGES["averaged"].apply(lrhs, None, 4)
        self.assertEqual(lrhs.pixels.shape, (SIZE // 4, SIZE // 4, before.shape[2]))
        numpy.testing.assert_allclose(lrhs.pixels[1, 2], before[4:8, 8:12].mean((0, 1)), rtol=1e-5)

    def test_program_agrees_with_pytorch(self):
        if not MODEL:
            self.skipTest("no program or model")
        results = agreement.check(Model.load(MODEL), self.view, PROGRAM)
        self.assertTrue(agreement.agrees(results), results)

    def test_alpha_changes_nothing(self):
        if not MODEL:
            self.skipTest("no program or model")
        model = Model.load(MODEL)
        plain, ramp = (tables.base(model, change).image(self.view, PROGRAM)[0] for change in ("", "alpha"))
        numpy.testing.assert_array_equal(plain, ramp)


class Numerics(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.study = numerics.Study(PROGRAM, DATA, self.folder, self.folder / "cache")

    def test_error_of_a_known_size(self):
        exact = torch.full((3, 4, 4), 0.5, dtype=torch.float64)
        self.assertAlmostEqual(float(numerics.relative(exact * 1.01, exact, 0.18).max()), 0.005 / 0.51, 9)
        self.assertAlmostEqual(numerics.steps(exact, exact * 0, 2), 255)
        image = exact.clone()
        image[1, 2, 3] = math.nan
        self.assertEqual(float(numerics.relative(image, exact, 1).max()), math.inf)
        image[1, 2, 3] = math.inf
        self.assertEqual(float(numerics.relative(image, exact, 1).max()), math.inf)
        self.assertEqual(float(numerics.relative(exact, exact, 1).max()), 0)

    def test_every_input_class_changes_something_and_no_size(self):
        rendered = pair(DATA, 4, "as rendered")
        for one in CLASSES:
            changed = pair(DATA, 4, one.name)
            same = [numpy.array_equal(a.pixels, b.pixels) for a, b in zip(changed, rendered)]
            self.assertEqual(all(same), one.name == "as rendered", one.name)
            self.assertEqual([a.pixels.shape for a in changed], [b.pixels.shape for b in rendered], one.name)

    def test_a_crop_of_both_is_of_the_same_pixels(self):
        """LRHS is nearer to the reference's cells than to those of the reference shifted by one pixel of LRHS."""
        reference = crop(DATA / "reference.exr").pixels
        for scale in (2, 4, 8):
            low = crop(DATA / f"lrhs-x{scale}.exr", scale).pixels
            off = lambda shift: numpy.abs(low - cells(numpy.roll(reference, shift, 1), scale)).mean()
            self.assertLess(off(0), min(off(scale), off(-scale)))

    def test_program_is_near_float64(self):
        """The program is as near as single precision is. A network with one weight off by a fiftieth is further."""
        if not MODEL:
            self.skipTest("no program or model")
        most = 1e-3
        model = Model.load(MODEL)
        _, result = self.study.measure(model, "as rendered", [Choice("fp32", "direct", ("--kernels", "direct"))])
        self.assertLess(result.max_relative, most)
        self.assertGreater(result.max_relative, 0)

        tensors, metadata = safetensors.load(MODEL)
        tensors = {name: value.copy() for name, value in tensors.items()}
        tensors["rec.weight"][0, 0, 1, 1] *= 1.02
        safetensors.save(self.folder / "off.safetensors", tensors, metadata)
        files = self.study.inputs(4, "as rendered")
        exact, off = (
            agreement.predict(networks.load(path), *files, torch.float64)
            for path in (MODEL, self.folder / "off.safetensors")
        )
        self.assertGreater(float(numerics.relative(off, exact, 1).max()), 3 * most)

    def test_caches_are_our_own_wherever_they_lie(self):
        """The caches are not the user's, whose tuning would be lost."""
        if not PROGRAM:
            self.skipTest("no program")
        home, cache = self.folder / "home", self.folder / "cache"
        choice = Choice("fp32", "F(2, 3)", kernel=WINOGRAD)
        with mock.patch.dict(os.environ, HOME=str(home)):
            relative = os.path.relpath(cache)
            choice.start(PROGRAM, pathlib.Path(relative))
            self.assertEqual(len(list(cache.glob("*/raymeld/tuning-*-fp32.json"))), 1)
            self.assertFalse(home.exists())
            with self.assertRaisesRegex(RuntimeError, f"expected a file in '{relative}'"):
                choice.tune(PROGRAM, (), os.environ | {"XDG_CACHE_HOME": relative})

    def test_rows_have_their_place_whenever_they_were_measured(self):
        row = lambda model, name, kernels: numerics.Result(model, name, "fp32", kernels, "fused", 1.0)
        rows = [row("x4-fast", "as rendered", "PyTorch"), row("x4-fast", "as rendered", "auto")]
        rows += [row("x4-fast", "lamp 1e8", "direct"), row("x2-fast", "as rendered", "direct")]
        self.assertEqual(sorted(reversed(rows), key=numerics.Result.place), rows)

    def test_results_are_read_as_written(self):
        results = [
            numerics.Result("m", "as rendered", "fp32", "auto", "fused", 1.5, math.inf, 0.25, 2.0, 3, 0, None, None),
            numerics.Result("m", "constant", "fp16", "auto", "cannot, so it does not", 2.0),
        ]
        numerics.write(self.folder / "numerics.csv", results)
        self.assertEqual(numerics.load(self.folder / "numerics.csv"), results)
        self.assertEqual(len(numerics_pages.broken_sheet(results).rows), 2)


if __name__ == "__main__":
    PROGRAM, MODEL = (list(map(pathlib.Path, sys.argv[1:3])) + [None, None])[:2]
    unittest.main(argv=sys.argv[:1])

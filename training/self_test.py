#!/usr/bin/python3
"""Tests the network's choices and the making of training pairs."""

import dataclasses
import json
import pathlib
import random
import tempfile
import types
import unittest
from unittest import mock

import numpy
import torch

import compact
import compiled
import dataset
import grow
import kernel_filter
import model
import pyramid
import safetensors
import stock
import train


class Lookalike(dataset.View):
    """Stands for a view; its images are smooth ramps, so that every crop shows where it comes from."""

    def __init__(self, size=96):
        y, x = torch.meshgrid(torch.arange(size) / size, torch.arange(size) / size, indexing="ij")
        color = torch.stack([0.2 + x, 0.3 + y, 0.4 + x * y])
        normal = torch.stack([x - 0.5, 0.5 - y, x**0])  # y points up
        self.image = torch.cat([color, color / 2, normal, color, 0 * color])
        self._mean_sqrt = None
        self.spp = {name: 16 for name in (*dataset.REFERENCE, *self.full_size())}
        self.spp |= {f"lowres-x{scale}-0016": 16 for scale in (2, 4, 8)}

    def read(self, name):
        small = name.startswith("lowres")
        return torch.nn.functional.avg_pool2d(self.image, int(name[8])) if small else self.image.clone()


def bent(config, **choices):
    return dataclasses.replace(config, **choices)


class Choices(unittest.TestCase):
    def test_metadata_comes_back(self):
        for config in [stock.config(name) for name in stock.names()] + [
            model.Config(),
            model.Config(2, merge_relu=True),
        ]:
            self.assertEqual(model.Config.parse(config.metadata()), config)

    def test_shapes(self):
        for choices in (
            {},
            {"hrls_encoder": "unshuffled"},
            {"upscale": "direct", "upscaled_features": 5, "guide": "hrls"},
        ):
            config = model.Config(4, 6, 4, 2, 1, 1, **choices)
            fused = model.predict(model.Network(config), torch.rand(2, 3, 4, 5), torch.rand(2, 18, 16, 20))[1]
            self.assertEqual(tuple(fused.shape), (2, 3, 16, 20))

    def test_centered_lrhs_has_a_bias_of_its_own(self):
        config = bent(stock.config("x4-full"), base="none")
        network = model.Network(config)
        network.lrhs.centered_bias.data += 1
        images = torch.rand(1, 3, 4, 4), torch.rand(1, 18, 16, 16)
        alike = [model.predict(network, *images, torch.tensor(centered))[0] for centered in (False, True)]
        self.assertFalse(torch.equal(*alike))

    def test_exposure_follows_the_inputs(self):
        config, lrhs = stock.config("x4-balanced"), torch.rand(1, 3, 8, 8)
        self.assertAlmostEqual(model.exposure(lrhs, config) / model.exposure(8 * lrhs, config), 8, places=4)
        self.assertEqual(model.exposure(0 * lrhs, config), 1)


def random_pyramid(scale):
    config = bent(stock.config("x2-balanced"), scale=scale, widths=("8", "7", "6", "5"), upscaled_features=4)
    network = model.create(config)
    for name, value in network.state_dict().items():
        value.copy_(torch.randn(value.shape) * (0.1 if name.endswith("weight") else 0.5))
    return network


class Pyramid(unittest.TestCase):
    def setUp(self):
        torch.manual_seed(3)

    def test_compiled_computes_the_same(self):
        x, logits = torch.rand(2, 3, 7, 9), 3 * torch.randn(2, 25, 7, 9)
        for side in (1, 3, 5):
            part = logits[:, : side**2]
            expected = kernel_filter.slow_kernel_filter(x.double(), part.double())
            torch.testing.assert_close(kernel_filter.kernel_filter(x, part).double(), expected, rtol=1e-5, atol=1e-6)

            expected = kernel_filter.slow_squared_distances(x.double(), side)
            torch.testing.assert_close(kernel_filter.squared_distances(x, side).double(), expected)

    def test_compiled_has_the_same_gradient(self):
        x, logits = torch.rand(2, 3, 6, 5), torch.randn(2, 9, 6, 5)
        gradients = []
        both = (kernel_filter.kernel_filter, torch.float), (kernel_filter.slow_kernel_filter, torch.double)
        for filtered, kind in both:
            own = logits.to(kind, copy=True).requires_grad_()
            (filtered(x.to(kind), own) ** 2).sum().backward()
            gradients.append(own.grad.double())
        torch.testing.assert_close(*gradients, rtol=1e-4, atol=1e-6)

    def test_any_size_has_its_output(self):
        for scale in (1, 2, 4, 8):
            lrhs, hrls = torch.rand(2, 3, 3, 5) if scale > 1 else None, torch.rand(2, 18, 3 * scale, 5 * scale)
            y, fused = model.predict(random_pyramid(scale), lrhs, hrls, torch.tensor(True))
            self.assertEqual(tuple(fused.shape), (2, 3, 3 * scale, 5 * scale))
            self.assertTrue(torch.isfinite(y).all())

    def test_samples_and_sampling_count(self):
        network, images = random_pyramid(2), (torch.rand(1, 3, 8, 8), torch.rand(1, 18, 16, 16))
        spp = lambda low, high: torch.tensor([float(low), float(high)]).reshape(1, 2, 1, 1)
        cases = [(True, spp(4, 1)), (False, spp(4, 1)), (True, spp(16, 1)), (True, spp(4, 2))]
        with torch.no_grad():
            first, *others = [model.predict(network, *images, torch.tensor(at), spp=n)[0] for at, n in cases]
        for other in others:
            self.assertGreater(float((other - first).abs().max()), 1e-3)

    def test_gradient_of_what_samples_change(self):
        """Compares gradients with finite differences, in double precision."""
        network, weigh = random_pyramid(2).double(), torch.rand(2, 3, 16, 16).double()
        images = torch.rand(2, 3, 8, 8).double(), torch.rand(2, 18, 16, 16).double()
        spp = torch.tensor([[64.0, 4.0], [16.0, 1.0]]).double()[..., None, None]
        for centered in torch.tensor([False, True]):
            value = lambda: (model.predict(network, *images, centered, spp=spp)[0] * weigh).sum()
            network.zero_grad()
            value().backward()
            for tensor in (network.lrhs.by_spp, network.hrls.by_spp):
                along, step, ends = torch.randn_like(tensor), 1e-6, []
                for sign in (1, -1):
                    with torch.no_grad():
                        tensor += sign * step * along
                        ends.append(float(value()))
                        tensor -= sign * step * along
                slope = (ends[0] - ends[1]) / (2 * step)
                self.assertNotEqual(slope, 0)
                self.assertAlmostEqual(slope, float((tensor.grad * along).sum()), delta=1e-3 * abs(slope) + 1e-5)

    def test_at_another_scale_it_starts_as_it_was_without_lrhs(self):
        half = random_pyramid(2)
        half.lrhs.weight.data[:, half.lrhs.weight.shape[0] :] = 0
        half.lrhs.by_spp.data.zero_()
        high, spp = torch.rand(1, 21, 32, 32), torch.tensor([4.0, 2.0]).reshape(1, 2, 1, 1)
        for scale in (4, 1):
            other = random_pyramid(scale)
            own = {key: value * (key != "lrhs.by_spp") for key, value in other.state_dict().items()}
            other.load_state_dict(grow.rejoined(half.state_dict(), half.config, other.config, own))
            with torch.no_grad():
                expected = half(high, torch.rand(1, 6, 16, 16), torch.ones(1), spp)
                result = other(high, torch.rand(1, 6, 8, 8) if scale == 4 else None, torch.ones(1), spp)
            torch.testing.assert_close(result[0], expected[0])
            torch.testing.assert_close(result[1], expected[1])
        back = grow.rejoined(other.state_dict(), other.config, half.config, half.state_dict())
        self.assertEqual(back.keys(), half.state_dict().keys())
        self.assertTrue(torch.equal(back["lrhs.weight"][:, :8], other.state_dict()["level.1.weight"]))
        self.assertFalse(grow.differs_in_lrhs_alone(half.config, stock.config("x4-balanced")))

    def test_a_wider_pyramid_starts_as_the_narrow_one(self):
        small = random_pyramid(4)
        large = model.create(bent(small.config, widths=("9", "9", "7", "8"), upscaled_features=6))
        self.assertTrue(grow.is_narrower(small.config, large.config))
        self.assertFalse(grow.is_narrower(large.config, small.config))
        large.load_state_dict(grow.widened(small.state_dict(), small.config, large.config, large.state_dict()))
        inputs = torch.rand(1, 21, 32, 32), torch.rand(1, 6, 8, 8), torch.ones(1), torch.full((1, 2, 1, 1), 4.0)
        result, expected = large(*inputs), small(*inputs)
        torch.testing.assert_close(result, expected, rtol=1e-4, atol=1e-5)

    def test_a_batch_is_its_images(self):
        network, lrhs, hrls = random_pyramid(4), torch.rand(2, 3, 4, 4), torch.rand(2, 18, 16, 16)
        centered = torch.tensor([True, False]).reshape(2, 1, 1, 1)
        spp = torch.tensor([[16.0, 1.0], [64.0, 2.0]]).reshape(2, 2, 1, 1)
        with torch.no_grad():
            both = model.predict(network, lrhs, hrls, centered, spp=spp)[0]
            for i in range(2):
                one = slice(i, i + 1)
                alone = model.predict(network, lrhs[one], hrls[one], centered[i], spp=spp[one])[0]
                torch.testing.assert_close(both[one], alone, rtol=1e-4, atol=1e-5)


class Upscalers(unittest.TestCase):
    def test_they_begin_with_the_upsampled_lrhs(self):
        for name in model.UPSCALERS:
            with self.subTest(name):
                self.begins_with_the_upsampled_lrhs(stock.config(f"x4-{name}"))

    def begins_with_the_upsampled_lrhs(self, whole):
        torch.manual_seed(4)
        config = bent(whole, features=6, blocks=2)
        network, lrhs = model.create(config), torch.rand(2, 3, 3, 5)
        encoded, fused = model.predict(network, lrhs, torch.zeros(2, 0, 12, 20), torch.tensor(True))
        self.assertEqual(tuple(fused.shape), (2, 3, 12, 20))
        network.rec.weight.data.zero_()
        network.rec.bias.data.zero_()
        encoded = model.predict(network, lrhs, torch.zeros(2, 0, 12, 20), torch.tensor(True))[0]
        low = model.encode(lrhs, ("color",), config)
        torch.testing.assert_close(encoded, model.bilinear(low, 4, 1.5))
        self.assertEqual(model.Config.parse(whole.metadata()), whole)


class OtherDevices(unittest.TestCase):
    def test_an_image_is_computed_where_its_inputs_are(self):
        """Takes PyTorch's device without values, which refuses arithmetic with values of another device."""
        for name in ("x2-fast", "x4-balanced", "x4-fast"):
            config, device = stock.config(name), torch.device("meta")
            low, high = 96 // config.scale, 3 * len(config.hrls_layers)
            network = model.create(config).to(device)
            images = torch.rand(2, 3, low, low).to(device), torch.rand(2, high, 96, 96).to(device)
            spp = torch.ones(2, 2, 1, 1).to(device)
            encoded, fused = model.predict(network, *images, torch.tensor(True), spp=spp)
            self.assertEqual((encoded.device, fused.device), (device, device))

    def test_what_is_compiled_is_what_other_devices_compute(self):
        """Computes a network's image and gradients by the compiled filters and by PyTorch's operations."""
        for name in ("x2-fast", "x2-balanced"):
            config = stock.config(name)
            torch.manual_seed(1)
            network = model.create(config)
            images = torch.rand(1, 3, 16, 16), torch.rand(1, 3 * len(config.hrls_layers), 32, 32)
            results = []
            for takes in (compiled.takes, lambda x: False):
                with mock.patch.object(compiled, "takes", takes):
                    encoded = model.predict(network, *images, torch.tensor(True))[0]
                    network.zero_grad()
                    (encoded**2).sum().backward()
                gradients = (parameter.grad for parameter in network.parameters())
                results.append([encoded.detach(), *(g.clone() for g in gradients if g is not None)])
            for a, b in zip(*results, strict=True):
                torch.testing.assert_close(a, b, rtol=1e-3, atol=1e-4 * float(b.abs().max()) + 1e-6)


class Light(unittest.TestCase):
    def lights(self, color, albedo, lrhs, centered):
        config, spp = stock.config("x4-fast"), torch.tensor([16.0, 1.0])[None, :, None, None]
        return pyramid.lights_of(model.create(config), color, albedo, lrhs, torch.tensor(centered), spp)

    def test_fireflies_are_darkened_and_lamps_are_not(self):
        color = torch.full((1, 3, 16, 16), 0.25)
        color[..., 3, 3] = 50
        color[..., 6, 5:7] = color[..., 7, 5] = 50
        expected = color.clone()
        expected[..., 3, 3] = model.FIREFLY * 0.25 + model.FIREFLY_FLOOR
        lights, _ = self.lights(color, torch.full_like(color, 0.6), color[..., ::4, ::4], True)
        torch.testing.assert_close(pyramid.expanded(lights[0]), expected)

    def test_lrhs_has_the_albedo_and_the_place_that_it_shows(self):
        albedo = torch.zeros(1, 3, 16, 16)
        albedo[..., ::4, ::4] = 1.6
        color, lrhs = torch.ones(1, 3, 16, 16), torch.full((1, 3, 4, 4), 3.0)
        for centered, surface in ((True, 0.1), (False, 1.6)):
            lights, own = self.lights(color, albedo, lrhs, centered)
            torch.testing.assert_close(pyramid.expanded(own), lrhs / (surface + model.ALBEDO_FLOOR))
            light = color / (albedo + model.ALBEDO_FLOOR)
            if not centered:  # a pixel of LRHS has 16 samples, and one of HRLS has 1
                light[..., ::4, ::4] = (1 + 16 * 3) / 17 / (1.6 + model.ALBEDO_FLOOR)
            torch.testing.assert_close(pyramid.expanded(lights[0]), light)
            mean = torch.nn.functional.avg_pool2d(lights[1], 2)
            torch.testing.assert_close(lights[2], (mean + own) / 2)  # both have 16 samples


class Losses(unittest.TestCase):
    def test_what_is_beyond_the_clip_is_no_error(self):
        config, reference = stock.config("x4-fast"), torch.rand(1, 3, 8, 8)
        reference[..., 3, 3] = 1000
        encoded = model.encode_layer(reference, "color", config)
        for name in (*train.ENCODED_LOSSES, "robust"):
            run = types.SimpleNamespace(args=types.SimpleNamespace(loss=name, beta=0.1), config=config)
            self.assertLess(float(train.Run.error(run, encoded, reference)), 1e-3, name)
            self.assertGreater(float(train.Run.error(run, 0 * encoded, reference)), 0.1, name)


class Packed(unittest.TestCase):
    def test_what_was_packed_comes_back(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "view-00010-0.safetensors"
            render = numpy.random.rand(19, 8, 8).astype(numpy.float16)
            record = {"files": {"0001.exr": {"spp": 1}}}
            safetensors.save(path, {"0001": render, "guides-0002": render[:7] / 2}, {"view": json.dumps(record)})
            training, held_out = dataset.load(folder)
            self.assertEqual((len(training), len(held_out)), (0, 1))
            numpy.testing.assert_array_equal(held_out[0].read("0001").numpy(), render)
            numpy.testing.assert_array_equal(held_out[0].read("guides-0002").numpy(), render[:7] / 2)
            self.assertEqual(held_out[0].spp, {"0001": 1})


class Compact(unittest.TestCase):
    def setUp(self):
        self.rng = numpy.random.default_rng(2)
        self.x = (self.rng.lognormal(0, 2, (19, 48, 48)) * (self.rng.random((19, 48, 48)) < 0.8)).astype(numpy.float16)
        self.x[3:9] = self.rng.uniform(-1, 1, (6, 48, 48))

    def test_light_and_guides_come_nearly_back(self):
        for name, bits in (("0004", 4), ("reference-a", 5)):
            back = compact.restored(name, compact.shrunk(name, self.x, self.rng)).astype(float)
            light = self.x[compact.LIGHT].astype(float)
            numpy.testing.assert_allclose(back[compact.LIGHT], light, rtol=2.0**-bits, atol=1e-6)
            self.assertTrue((back[compact.LIGHT][light == 0] == 0).all())
            self.assertAlmostEqual((back[compact.LIGHT] / light.clip(1e-7))[light > 1e-3].mean(), 1, delta=2e-3)
        back = compact.restored("0004", compact.shrunk("0004", self.x, self.rng))
        numpy.testing.assert_allclose(back[3:9], self.x[3:9], atol=0.51 / 127)
        guides = compact.restored("guides-0002", compact.shrunk("guides-0002", self.x[3:10], self.rng))
        numpy.testing.assert_allclose(guides, self.x[3:9], atol=0.51 / 127)

    def test_a_view_is_packed_whole(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            record = {"files": {"0001.exr": {"spp": 1}, "guides-0002.exr": {"spp": 2}}}
            tensors = {"0001": self.x, "guides-0002": self.x[:7]}
            safetensors.save(folder / "view-00001-0.safetensors", tensors, {"view": json.dumps(record)})
            compact.pack(folder / "view-00001-0.safetensors", folder)
            compact.unpack(folder / "view-00001-0.xz", folder)
            view = dataset.View(folder / "view-00001-0.safetensors")
            self.assertEqual(view.record, record)
            self.assertEqual(tuple(view.read("0001").shape), (15, 48, 48))
            self.assertEqual(tuple(view.read("guides-0002").shape), (6, 48, 48))


class Trainable(unittest.TestCase):
    def test_views_without_small_renders_are_left_to_models_that_need_none(self):
        view = lambda *scales: types.SimpleNamespace(small=lambda scale: ["lowres"] * (scale in scales))
        views = [view(2, 4), view(2)]
        left = lambda scale, *sampling: len(dataset.trainable(views, model.Config(scale, lrhs_sampling=sampling)))
        counts = left(4, "centered", "nearest"), left(2, "centered"), left(4, "nearest"), left(1)
        self.assertEqual(counts, (1, 2, 2, 2))


class Pairs(unittest.TestCase):
    def sample(self, seed, scale=4, sampling=("nearest",)):
        config = bent(stock.config(f"x{scale}-fast"), lrhs_sampling=sampling, optional_layers=())
        with mock.patch.object(dataset, "add_fireflies"):
            return dataset.batch([Lookalike()], config, 32, 3, seed)

    def test_nearest_samples_lie_on_the_reference(self):
        """All images show one scene, whatever the mirroring, transposition, layer weights, exposure and channels."""
        for seed in range(20):
            lrhs, hrls, reference, centered, _ = self.sample(seed)
            self.assertFalse(centered.any())
            torch.testing.assert_close(lrhs, reference[..., ::4, ::4])
            torch.testing.assert_close(hrls[:, :3], reference)

    def test_small_renders_are_means_of_the_reference(self):
        for scale in (2, 4, 8):
            for seed in range(10):
                lrhs, hrls, reference, centered, spp = self.sample(seed, scale, ("centered",))
                self.assertTrue(centered.all())
                mean = torch.nn.functional.avg_pool2d(reference, scale)
                for one, expected, count in zip(lrhs, mean, spp[:, 0]):
                    # A render that was upsampled, and so has 4 samples, replicates the edge of the view.
                    inside = ... if count == 16 else (..., slice(1, -1), slice(1, -1))
                    torch.testing.assert_close(one[inside], expected[inside], rtol=1e-3, atol=1e-3)
                torch.testing.assert_close(hrls[:, :3], reference)

    def test_a_sample_of_x8_counts_for_four_pixels(self):
        config = bent(stock.config("x4-fast"), lrhs_sampling=("centered",))
        counts = dataset.batch([Lookalike()], config, 32, 40, 1)[4][:, 0].flatten().tolist()
        self.assertEqual(set(counts), {16, 4})
        self.assertLess(counts.count(4), 20)

    def test_target_and_inputs_share_no_noise(self):
        view, rng = Lookalike(), random.Random(1)
        for _ in range(100):
            low, parts = dataset.pick_lrhs(view, 4, "0001", False, rng)
            self.assertNotEqual(low, "0001")
            self.assertNotIn(low, parts)
            self.assertTrue(parts)

    def test_light_is_weighed_alike(self):
        """The color stays the sum of diffuse, specular and the rest."""
        rng = random.Random(3)
        layers = [torch.rand(8, 15, 4, 4) for _ in range(2)]
        rest = [0.1 * torch.rand(8, 3, 4, 4) for _ in layers]
        for image, other in zip(layers, rest):
            image[:, :3] = image[:, 9:12] + image[:, 12:15] + other
        before = layers[0].clone()
        dataset.reweigh(layers, rng)
        changed = (layers[0] != before).flatten(1).any(1)
        self.assertTrue(changed.any() and not changed.all())
        for image, other in zip(layers, rest):
            torch.testing.assert_close(image[:, :3], image[:, 9:12] + image[:, 12:15] + other)

    def test_normals_turn_with_the_image(self):
        """The surface bends to the right and downwards, and must do so in every augmented image."""
        images = Lookalike().image.repeat(40, 1, 1, 1)
        mirrored = [(i % 2 == 0, i % 4 < 2) for i in range(40)]
        normal = dataset.augment([images], mirrored, random.Random(1))[0][:, 6:9]
        self.assertGreater(float((normal[:, 0, :, 1:] - normal[:, 0, :, :-1]).min()), 0)
        self.assertLess(float((normal[:, 1, 1:] - normal[:, 1, :-1]).max()), 0)

    def test_crops_are_mirrored_as_asked_and_some_are_transposed(self):
        y, x = torch.meshgrid(torch.arange(8.0), torch.arange(8.0), indexing="ij")
        mirrored = [[i % 2 == 0, i % 4 < 2] for i in range(40)]
        images = (10 * y + x).repeat(40, 15, 1, 1)
        image = dataset.augment([images], mirrored, random.Random(1))[0][:, 0]
        along_x, along_y = image[:, 0, 1] - image[:, 0, 0], image[:, 1, 0] - image[:, 0, 0]
        turned = along_x.abs() == 10
        self.assertTrue(turned.any() and not turned.all())
        down, right = torch.where(turned, along_x, along_y) < 0, torch.where(turned, along_y, along_x) < 0
        self.assertEqual(torch.stack([down, right], dim=1).tolist(), mirrored)

    def test_all_images_of_a_crop_are_augmented_alike(self):
        images = torch.rand(6, 15, 8, 8)
        small = torch.nn.functional.avg_pool2d(images, 2)
        large, small = dataset.augment([images, small], [(True, False)] * 6, random.Random(2))
        torch.testing.assert_close(torch.nn.functional.avg_pool2d(large, 2), small)

    def test_dropped_layers_are_black(self):
        hrls = torch.ones(400, 18, 4, 4)
        dataset.drop_layers(hrls, stock.config("x4-fast"), random.Random(1))
        self.assertTrue((hrls[:, :3] == 1).all() and (hrls[:, 15:] == 1).all())
        self.assertEqual({int(crop) // 48 for crop in (hrls == 0).flatten(1).sum(1)}, {0, 1, 4})

    def test_fireflies_are_of_all_light(self):
        layers = torch.ones(100, 15, 40, 40)
        dataset.add_fireflies(layers, random.Random(1))
        bright = layers != 1
        self.assertTrue((layers[bright] > 9).all())
        self.assertFalse(bright[:, 3:9].any())
        self.assertTrue((bright[:, 0] == bright[:, 14]).all())
        self.assertEqual({int(crop) for crop in bright[:, 0].flatten(1).sum(1)}, {0, 1})


if __name__ == "__main__":
    unittest.main()

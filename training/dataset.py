"""Rendered views in memory, and random training pairs out of them."""

import math
import pathlib
import random

import numpy
import OpenImageIO as oiio
import torch

import model

PASSES = {
    "color": "Combined.RGB",
    "albedo": "Denoising Albedo.RGB",
    "normal": "Denoising Normal.XYZ",
}
HRLS_SPP = (1, 2, 4, 8)
# Channels of a view's layers that carry radiance; the normal has 6, 7 and 8.
RADIANCE = [0, 1, 2, 9, 10, 11, 12, 13, 14]
LAYERS = ("color", "albedo", "normal", "diffuse", "specular")
TARGET_CLIP = 100.0  # as in section 3.2 of Hou et al. 2021


def read(path, passes):
    """[3 * len(passes), H, W], float32, out of a Blender multilayer file with one view layer."""
    image = oiio.ImageBuf(str(path))
    pixels = image.get_pixels(oiio.FLOAT)
    if image.has_error:
        raise OSError(f"{path}: {image.geterror()}")
    names = [name.split(".", 1)[-1] for name in image.spec().channelnames]

    def rgb(name):
        layer, channels = name.rsplit(".", 1)
        return numpy.stack([pixels[..., names.index(f"{layer}.{c}")] for c in channels])

    def lit(kind):
        return rgb(f"{kind}Col.RGB") * (rgb(f"{kind}Dir.RGB") + rgb(f"{kind}Ind.RGB"))

    derived = {"diffuse": lambda: lit("Diff"), "specular": lambda: lit("Gloss")}
    layers = [rgb(PASSES[p]) if p in PASSES else derived[p]() for p in passes]
    return torch.from_numpy(numpy.ascontiguousarray(numpy.concatenate(layers)))


class View:
    """All renders of one view, in half precision.

    layers[spp] [15, H, W]: LAYERS; colors[spp] [3, H, W]; reference [3, H, W]: the mean of both halves.
    """

    def __init__(self, folder):
        spp = sorted(int(path.stem) for path in folder.glob("[0-9]*.exr"))
        half = lambda image: image.clamp(-model.HALF_MAX, model.HALF_MAX).half()
        self.layers = {s: half(read(folder / f"{s:04}.exr", LAYERS)) for s in spp if s in HRLS_SPP}
        color = lambda s: self.layers[s][:3] if s in self.layers else half(read(folder / f"{s:04}.exr", ("color",)))
        self.colors = {s: color(s) for s in spp}
        halves = [read(folder / f"reference-{half}.exr", ("color",)).clamp(0, TARGET_CLIP) for half in "ab"]
        reference = sum(halves) / 2
        self.reference = reference.half()
        self.mean_sqrt = float(model.luminance(reference).sqrt().mean())

    def lrhs(self, spp, hrls_spp):
        """The full-size render LRHS is made of; beyond the largest: the mean of all others than HRLS."""
        if spp in self.colors:
            return self.colors[spp].float()
        others = [s for s in self.colors if s != hrls_spp]
        return sum(s * self.colors[s].float() for s in others) / sum(others)

    def exposure(self, config):
        """As model.exposure of a clean LRHS."""
        return config.exposure_key / max(self.mean_sqrt, 1e-3) ** 2 if config.exposure_key else 1.0


def read_view(folder):
    """A View; read from its renders only once, as that takes long."""
    kept = folder / "view.pt"
    if kept.exists():
        return torch.load(kept)
    view = View(folder)
    torch.save(view, kept.with_suffix(".part"))
    kept.with_suffix(".part").rename(kept)
    return view


def load(folder):
    """(training views, validation views): every tenth seed is held out."""
    folders = sorted(f for f in pathlib.Path(folder).glob("view-*") if f.is_dir() and not f.suffix)
    held_out = [f for f in folders if int(f.name[5:]) % 10 == 0]
    return [read_view(f) for f in folders if f not in held_out], [read_view(f) for f in held_out]


def with_variance(layers):
    """[15, H, W] -> [18, H, W]."""
    return torch.cat([layers, model.variance(layers[None, :3])[0]])


def pixel_filter(scale):
    """[3s], sum 1: what Cycles' default pixel filter at 1/scale of the size weighs full-size pixels -s to 2s of a cell by.

    A Blackman-Harris window three pixels wide: Blender's 1.5 is half of it. Measured on a render: a window of 2.8.
    """
    x = torch.arange(-1.5 * scale + 0.5, 1.5 * scale)
    phase = 2 * math.pi * (x / (3 * scale) + 0.5)
    window = 0.35875 - 0.48829 * torch.cos(phase) + 0.14128 * torch.cos(2 * phase) - 0.01168 * torch.cos(3 * phase)
    return window / window.sum()


def centered(color, scale, count, seed):
    """[3, H, W] of n spp -> [3, H/s, W/s] as a low-resolution render of `count` n spp: pixels drawn by its filter."""
    height, width = color.shape[-2:]
    rows, columns = torch.arange(0, height, scale), torch.arange(0, width, scale)
    shape = (2, count, len(rows), len(columns))
    generator = torch.Generator().manual_seed(seed)
    offsets = torch.multinomial(pixel_filter(scale), math.prod(shape), True, generator=generator).reshape(shape) - scale
    y = (rows[:, None] + offsets[0]).clamp(0, height - 1)
    x = (columns + offsets[1]).clamp(0, width - 1)
    return color[:, y, x].mean(1)


def spp_pair(scale, rng):
    """(LRHS, HRLS) samples a pixel; half the time one of the paper's Table 2."""
    if rng.random() < 0.5:
        high = rng.choice((1, 1, 2, 4))
        return scale * scale * high, high
    high = rng.choice(HRLS_SPP)
    return rng.choice([s for s in (4, 8, 16, 32, 64) if s > high]), high


def augment(layers, reference, color, rng):
    """The same random mirroring, transposition and permutation of the color channels for all three.

    Normals are in camera space (x right, y up), so they follow the mirroring.
    """
    images = [layers, reference, color]
    if rng.random() < 0.5:
        images = [i.flip(-1) for i in images]
        images[0][6] *= -1
    if rng.random() < 0.5:
        images = [i.flip(-2) for i in images]
        images[0][7] *= -1
    if rng.random() < 0.5:
        images = [i.transpose(-1, -2) for i in images]
        images[0][6:8] = -images[0][6:8].flip(0)
    order = rng.sample(range(3), 3)
    rgb = lambda start: [start + c for c in order]
    return images[0][rgb(0) + rgb(3) + [6, 7, 8] + rgb(9) + rgb(12)], images[1][order], images[2][order]


def drop_layers(hrls, config, rng):
    """Blanks optional layers as if the file lacked them: all of them, or one, each in a tenth of the samples."""
    chance = rng.random()
    if not config.optional_layers or chance > 0.2:
        return
    dropped = config.optional_layers if chance < 0.1 else [rng.choice(config.optional_layers)]
    for name in dropped:
        start = 3 * config.hrls_layers.index(name)
        hrls[start : start + 3] = 0


def add_fireflies(layers, rng):
    """Makes a thousandth of the pixels 10 to 1000 times as bright, in a tenth of the samples."""
    if rng.random() > 0.1:
        return
    height, width = layers.shape[-2:]
    for _ in range(height * width // 1000):
        layers[RADIANCE, rng.randrange(height), rng.randrange(width)] *= 10 ** rng.uniform(1, 3)


def sample(views, config, size, rng):
    """One random crop: lrhs [3, size/s, size/s], hrls [K, size, size], reference [3, size, size], centered or not."""
    scale = config.scale
    view = rng.choice(views)
    low, high = spp_pair(scale, rng)
    is_centered = "centered" in config.lrhs_sampling and rng.random() < 0.35
    wanted = low
    if is_centered:  # many samples are gathered from pixels of few
        low = rng.choice([s for s in (1, 2, 4) if s != high and s <= wanted])
    height, width = view.reference.shape[-2:]
    y, x = rng.randint(0, height - size), rng.randint(0, width - size)
    cut = (slice(None), slice(y, y + size), slice(x, x + size))
    images = (view.layers[high].float()[cut], view.reference[cut].float(), view.lrhs(low, high)[cut])
    layers, reference, color = augment(*images, rng)
    exposure = 2 ** rng.uniform(-1.5, 1.5) * view.exposure(config)
    layers[RADIANCE] *= exposure
    add_fireflies(layers, rng)
    hrls = with_variance(layers)
    drop_layers(hrls, config, rng)
    if is_centered:
        lrhs = centered(color, scale, wanted // low, rng.getrandbits(32))
    else:
        lrhs = color[:, ::scale, ::scale]
    return lrhs * exposure, hrls, reference * exposure, torch.tensor(is_centered).reshape(1, 1, 1)


def batch(views, config, size, count, seed):
    rng = random.Random(seed)
    return tuple(torch.stack(images) for images in zip(*(sample(views, config, size, rng) for _ in range(count))))


def pair(view, config, low, high):
    """A whole view as the network reads it, batch of one: lrhs, hrls, reference, and the exposure of all three."""
    exposure = view.exposure(config)
    layers = view.layers[high].float()
    layers[RADIANCE] *= exposure
    lrhs = view.lrhs(low, high)[None, :, :: config.scale, :: config.scale]
    return lrhs * exposure, with_variance(layers)[None], view.reference.float()[None] * exposure, exposure

"""Views in memory, and random training pairs out of them."""

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
    """All renders of one view. `layers[spp]`: color, albedo, normal, diffuse, specular; `colors[spp]`: color only."""

    def __init__(self, folder):
        self.layers, self.colors = {}, {}
        for path in sorted(folder.glob("[0-9]*.exr")):
            spp = int(path.stem)
            if spp <= 8:
                self.layers[spp] = read(path, ("color", "albedo", "normal", "diffuse", "specular")).half()
                self.colors[spp] = self.layers[spp][:3]
            else:
                self.colors[spp] = read(path, ("color",)).half()
        self.total = sum(spp * color.float() for spp, color in self.colors.items())

    def reference(self, *used):
        """Mean of all renders but those used as inputs, whose noise it must not share."""
        spp = sum(self.colors) - sum(used)
        return (self.total - sum(s * self.colors[s].float() for s in used)) / spp


def load(folder):
    """(training views, validation views): every tenth seed is held out."""
    folders = sorted(f for f in pathlib.Path(folder).glob("view-*") if f.is_dir() and not f.suffix)
    held_out = [f for f in folders if int(f.name[5:]) % 10 == 0]
    return [View(f) for f in folders if f not in held_out], [View(f) for f in held_out]


def with_variance(layers):
    return torch.cat([layers, model.variance(layers[None, :3])[0]])


def pairs_of(view, highest_lrhs_spp):
    return [(low, high) for low in view.colors for high in view.layers if high < low <= highest_lrhs_spp and low >= 4]


def augment(layers, reference, lrhs, rng):
    """The same random mirroring, transposition, exposure and colour permutation for all three.

    Normals are in camera space (x right, y up), so they follow the mirroring.
    """
    images = [layers.clone(), reference, lrhs]
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
    images = [images[0][rgb(0) + rgb(3) + [6, 7, 8] + rgb(9) + rgb(12)], images[1][order], images[2][order]]
    exposure = 2 ** rng.uniform(-1.5, 1.5)
    images[0][[0, 1, 2, 9, 10, 11, 12, 13, 14]] *= exposure
    return images[0], images[1] * exposure, images[2] * exposure


def sample(views, scale, size, rng, highest_lrhs_spp=32):
    """One random crop: lrhs [3, size/s, size/s], hrls [18, size, size], reference [3, size, size]."""
    view = rng.choice(views)
    low, high = rng.choice(pairs_of(view, highest_lrhs_spp))
    height, width = view.total.shape[-2:]
    y, x = rng.randint(0, height - size), rng.randint(0, width - size)
    cut = (slice(None), slice(y, y + size), slice(x, x + size))
    layers, reference = view.layers[high].float()[cut], view.reference(low, high)[cut]
    layers, reference, lrhs = augment(layers, reference, view.colors[low].float()[cut], rng)
    return lrhs[:, ::scale, ::scale], with_variance(layers), reference


def batch(views, scale, size, count, seed):
    rng = random.Random(seed)
    return tuple(torch.stack(images) for images in zip(*(sample(views, scale, size, rng) for _ in range(count))))


def pair(view, scale, low=16, high=1):
    """A whole view, batch of one, for validation."""
    lrhs = view.colors[low].float()[None, :, ::scale, ::scale]
    return lrhs, with_variance(view.layers[high].float())[None], view.reference(low, high)[None]

"""Reads rendered views and makes random training pairs out of them."""

import json
import pathlib
import random

import torch

import model
import safetensors

HRLS_SPP = (1, 2, 4, 8)
# These channels of LAYERS carry radiance; albedo has 3 to 5, the normal 6 to 8.
RADIANCE = [0, 1, 2, 9, 10, 11, 12, 13, 14]
LAYERS = ("color", "albedo", "normal", "diffuse", "specular")
LAYER_CHANNELS = 3 * len(LAYERS)
REFERENCE = ("reference-a", "reference-b")  # independent parts of 8 and 24 samples, of held-out seeds 64 and 192
TARGET_CLIP = 100.0  # limit at the view's exposure, section 3.2 of Hou et al. 2021
CENTERED_SHARE = 0.75  # share of crops with an ordinary small render; the others have every s-th pixel
COARSE_SHARE = 0.25  # share of the ordinary small renders for x4 that are of x8, upsampled
GUIDES_SHARE = 0.25  # share of crops whose albedo and normal are a render of their own


class View:
    """Holds a packed view (pack.py), and reads a render only when a sample takes it.

    A render is float16 [C, H, W] whose first channels are those of LAYERS.
    """

    def __init__(self, path):
        self.path, self.file = path, safetensors.Lazy(path)
        self.record = json.loads(self.file.metadata["view"])
        self.spp = {name.removesuffix(".exr"): about["spp"] for name, about in self.record["files"].items()}
        self._mean_sqrt = None

    def read(self, name):
        return torch.from_numpy(self.file.read(name))

    def noisy(self, spp):
        """Returns color, albedo and normal of a full-size render as arrays [H, W, 3]."""
        layers = self.read(f"{spp:04}")[:9].float()
        return [layer.permute(1, 2, 0).numpy() for layer in layers.split(3)]

    def full_size(self):
        """Returns the names of the renders that HRLS can be."""
        return [f"{spp:04}" for spp in HRLS_SPP]

    def small(self, scale):
        """Returns the names of the ordinary small renders."""
        return [name for name in self.spp if name.startswith(f"lowres-x{scale}-")]

    def read_lrhs(self, name, scale):
        """Returns (an ordinary small render [LAYERS, H / scale, W / scale], its samples a pixel).

        A render of twice the scale is upsampled, and each of its samples counts for the four pixels that it covers.
        """
        layers, own_scale = self.read(name)[:LAYER_CHANNELS].float(), int(name[len("lowres-x")])
        if own_scale == scale:
            return layers, self.spp[name]
        return model.bilinear(layers[None], 2, 0.5)[0], self.spp[name] / 4

    def guides(self):
        """Returns the names of the renders of albedo and normal alone."""
        return [name for name in self.spp if name.startswith("guides-")]

    def reference(self, parts=REFERENCE, here=...):
        """Returns the mean of the parts by their samples, float32 [LAYERS, H, W] or the window `here` of it."""
        total = sum(self.spp[part] for part in parts)
        return sum(self.spp[part] / total * self.read(part)[:LAYER_CHANNELS][here].float() for part in parts)

    def mean_sqrt(self):
        if self._mean_sqrt is None:
            self._mean_sqrt = float(model.luminance(self.reference()[:3].clamp(0, TARGET_CLIP)).sqrt().mean())
        return self._mean_sqrt

    def exposure(self, config):
        """Returns the model.exposure() of a clean LRHS."""
        return config.exposure_key / max(self.mean_sqrt(), 1e-3) ** 2 if config.exposure_key else 1.0


def load(folder):
    """Returns (training views, validation views); every tenth seed is held out for validation."""
    paths = sorted(pathlib.Path(folder).glob("view-*.safetensors"))
    held_out = [path for path in paths if int(path.stem.split("-")[1]) % 10 == 0]
    return [View(path) for path in paths if path not in set(held_out)], [View(path) for path in held_out]


def trainable(views, config):
    """Returns the views that have what a config's training may read: some lack small renders of a scale."""
    needs_small = config.reads_lrhs and "centered" in config.lrhs_sampling
    return [view for view in views if view.small(config.scale) or not needs_small]


def with_variance(layers):
    """Appends the variance of color: [15, H, W] becomes [18, H, W]."""
    return torch.cat([layers, model.variance(layers[None, :3])[0]])


def reweigh(images, rng):
    """Multiplies diffuse and specular by random colours, the same in all images, in half of the crops.

    `images` are [LAYERS, H, W]; color is the sum of diffuse, specular and a rest that stays.
    """
    if rng.random() < 0.5:
        return
    for start in (9, 12):
        factor = torch.tensor([2 ** rng.uniform(-1.5, 1) for _ in range(3)])[:, None, None]
        for image in images:
            image[:3] = (image[:3] + (factor - 1) * image[start : start + 3]).clamp(min=0)
            image[start : start + 3] *= factor


def augment(images, rng):
    """Mirrors, transposes and permutes the color channels of all images [LAYERS, H, W] in one random way.

    Normals are in camera space (x right, y up), so they follow the mirroring.
    """
    order = rng.sample(range(3), 3)
    right, down, turn = (rng.random() < 0.5 for _ in range(3))
    channels = (
        [start + c for start in (0, 3) for c in order] + [6, 7, 8] + [start + c for start in (9, 12) for c in order]
    )

    def moved(image):
        image = image[channels]
        if right:
            image = image.flip(-1)
            image[6] *= -1
        if down:
            image = image.flip(-2)
            image[7] *= -1
        if turn:
            image = image.transpose(-1, -2).clone()
            image[6:8] = -image[6:8].flip(0)
        return image

    return [moved(image) for image in images]


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


def window(y, x, size):
    return ..., slice(y, y + size), slice(x, x + size)


def pick_lrhs(view, scale, high, is_centered, rng):
    """Returns (name of the render that LRHS is made of, names of the target's parts, which share no noise with it).

    At a scale of 1, LRHS is HRLS itself.
    """
    if scale == 1:
        return high, REFERENCE
    if is_centered:
        coarse = view.small(2 * scale) if scale == 4 and rng.random() < COARSE_SHARE else []
        return rng.choice(coarse or view.small(scale)), REFERENCE
    low = rng.choice([*REFERENCE, *REFERENCE, *(name for name in view.full_size()[1:] if name != high)])
    return low, [part for part in REFERENCE if part != low]


def sample(views, config, size, rng):
    """Makes one random crop.

    Returns lrhs [3, size/s, size/s], hrls [K, size, size], reference [3, size, size], whether LRHS is centered, and the
    samples a pixel of LRHS and HRLS.
    """
    scale, view = config.scale, rng.choice(views)
    is_centered = config.lrhs_sampling == ("centered",)
    if len(config.lrhs_sampling) == 2:
        is_centered = rng.random() < CENTERED_SHARE
    high = rng.choice(("0001", "0001", "0002", "0004", "0008"))
    low, parts = pick_lrhs(view, scale, high, is_centered, rng)
    y, x = (rng.randint(0, (side - size) // scale) * scale for side in view.read(high).shape[-2:])
    here = window(y, x, size)
    reference = view.reference(parts, here)
    hrls = view.read(high)[:LAYER_CHANNELS][here].float() if config.reads_hrls else torch.zeros_like(reference)
    if is_centered:
        lrhs, low_spp = view.read_lrhs(low, scale)
        lrhs = lrhs[window(*(n // scale for n in (y, x, size)))]
    else:
        lrhs, low_spp = view.read(low)[:LAYER_CHANNELS][here].float(), view.spp[low]
    if config.reads_hrls and view.guides() and rng.random() < GUIDES_SHARE:
        hrls[3:9] = view.read(rng.choice(view.guides()))[:6][here]
    images = [hrls, reference, lrhs]
    reweigh(images, rng)
    hrls, reference, lrhs = augment(images, rng)
    exposure = 2 ** rng.uniform(-1.5, 1.5) * view.exposure(config)
    hrls[RADIANCE] *= exposure
    add_fireflies(hrls, rng)
    hrls = with_variance(hrls)
    drop_layers(hrls, config, rng)
    lrhs = (lrhs if is_centered else lrhs[:, ::scale, ::scale])[:3] * exposure
    reference = reference[:3].clamp(0, TARGET_CLIP) * exposure
    spp = torch.tensor([float(low_spp), float(view.spp[high])])
    return lrhs, hrls, reference, torch.tensor(is_centered).reshape(1, 1, 1), spp.reshape(2, 1, 1)


class Batches(torch.utils.data.Dataset):
    """Has a batch of random crops for every seed."""

    def __init__(self, views, config, size, count):
        self.arguments = views, config, size, count

    def __getitem__(self, seed):
        return batch(*self.arguments, seed)


def batch(views, config, size, count, seed):
    rng = random.Random(seed)
    return tuple(torch.stack(images) for images in zip(*(sample(views, config, size, rng) for _ in range(count))))


def pair(view, config, low, high, guides=None, decimated=None, small_scale=None):
    """Returns a whole view with its ordinary small render: lrhs, hrls, reference, exposure of all three, spp.

    The images are a batch of one. `small_scale` is the small render's, by default the config's. `guides`, if given, is
    the sample count of the separate render that albedo and normal of HRLS are taken from. `decimated`, if given, names
    a full-size render. LRHS is every s-th pixel of it then, and the reference has no part in it.
    """
    exposure = view.exposure(config)
    hrls = view.read(f"{high:04}")[:LAYER_CHANNELS].float()
    if guides:
        hrls[3:9] = view.read(f"guides-{guides:04}")[:6]
    hrls[RADIANCE] *= exposure
    if not config.reads_lrhs:
        low, lrhs = high, hrls
    elif decimated:
        low, lrhs = view.spp[decimated], view.read(decimated)[:, :: config.scale, :: config.scale].float()
    else:
        lrhs, low = view.read_lrhs(f"lowres-x{small_scale or config.scale}-{low:04}", config.scale)
    if config.reads_lrhs:
        lrhs = lrhs * exposure
    spp = torch.tensor([float(low), float(high)]).reshape(1, 2, 1, 1)
    reference = view.reference([part for part in REFERENCE if part != decimated])
    return lrhs[None, :3], with_variance(hrls)[None], reference[None, :3] * exposure, exposure, spp

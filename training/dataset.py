"""Reads rendered views and makes random training pairs out of them."""

import json
import pathlib
import random

import torch

import model
import safetensors

HRLS_SPP = (1, 2, 4, 8)
# These channels of LAYERS carry radiance; albedo has 3 to 5, the normal 6 to 8.
RADIANCE = torch.tensor([0, 1, 2, 9, 10, 11, 12, 13, 14])
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
        self.held = {}
        self._mean_sqrt = None

    def hold(self, device):
        """Keeps all renders on a device, so that samples are cut out there."""
        if not self.held:
            self.held = {name: self.read(name).to(device) for name in self.spp}
        self.mean_sqrt()

    def read(self, name):
        return self.held[name] if self.held else torch.from_numpy(self.file.read(name))

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
    """Appends the variance of color: [N, 15, H, W] becomes [N, 18, H, W]."""
    return torch.cat([layers, model.variance(layers[:, :3])], dim=1)


def on_each(values, like):
    """Returns values [N] or [N, C] as a tensor [N, 1 or C, 1, 1] where `like` is."""
    values = torch.tensor(values).to(like.device, non_blocking=True)
    return values.reshape(len(values), -1, 1, 1)


def reweigh(images, rng):
    """Multiplies diffuse and specular by random colours, the same in all images, in half of the crops.

    `images` are [N, LAYERS, H, W]; color is the sum of diffuse, specular and a rest that stays.
    """

    def drawn():
        return [2 ** rng.uniform(-1.5, 1) for _ in range(6)] if rng.random() < 0.5 else [1.0] * 6

    factors = on_each([drawn() for _ in images[0]], images[0])
    for image in images:
        change = (factors - 1) * image[:, 9:15]
        image[:, :3] = (image[:, :3] + change[:, :3] + change[:, 3:]).clamp(min=0)
        image[:, 9:15] *= factors


def augment(images, mirrored, rng):
    """Mirrors images [N, LAYERS, H, W], and transposes them and permutes their color channels in one random way a crop.

    `mirrored` says for each crop whether it is mirrored along y and x. Normals are in camera space (x right, y up), so
    they follow the mirroring.
    """

    def channels():
        order = rng.sample(range(3), 3)
        colors, normal = [[start + c for c in order] for start in (0, 3, 9, 12)], [6, 7, 8]
        return [*colors[0], *colors[1], *normal, *colors[2], *colors[3]]

    count = len(images[0])
    order = on_each([channels() for _ in range(count)], images[0])
    down, right = on_each(mirrored, images[0]).split(1, dim=1)
    turn = on_each([rng.random() < 0.5 for _ in range(count)], images[0])

    def flipped(image, axis, component, chosen):
        other = image.flip(axis)
        other[:, component] *= -1
        return torch.where(chosen, other, image)

    def moved(image):
        image = image.gather(1, order.expand(-1, -1, *image.shape[2:]))
        image = flipped(flipped(image, -1, 6, right), -2, 7, down)
        turned = image.transpose(-1, -2).clone()
        turned[:, 6:8] = -turned[:, 6:8].flip(1)
        return torch.where(turn, turned, image)

    return [moved(image) for image in images]


def drop_layers(hrls, config, rng):
    """Blanks optional layers as if the file lacked them: all of them, or one, each in a tenth of the crops."""

    def dropped():
        chance = rng.random()
        if not config.optional_layers or chance > 0.2:
            return ()
        return config.optional_layers if chance < 0.1 else [rng.choice(config.optional_layers)]

    crops = [dropped() for _ in hrls]
    blank = [[name in names for name in LAYERS for _ in range(3)] for names in crops]
    hrls[:, :LAYER_CHANNELS].masked_fill_(on_each(blank, hrls), 0)


def add_fireflies(layers, rng):
    """Makes a thousandth of the pixels 10 to 1000 times as bright, in a tenth of the crops."""
    count, _, height, width = layers.shape
    for image in (layers[i] for i in range(count) if rng.random() < 0.1):
        pixels = rng.sample(range(height * width), height * width // 1000)
        factors = torch.tensor([10 ** rng.uniform(1, 3) for _ in pixels]).to(image, non_blocking=True)
        at = torch.tensor(pixels, dtype=torch.long).to(image.device, non_blocking=True)
        image[RADIANCE[:, None].to(at.device), at // width, at % width] *= factors


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


def crop(view, config, size, mirrored, rng):
    """Cuts out a random place of a view, which is to be `mirrored` along y and x.

    An LRHS of every s-th pixel has its first pixel in the corner once it is mirrored. Returns lrhs
    [LAYERS, size/s, size/s], hrls [LAYERS, size, size], the two parts of the reference like hrls, each one's share of
    it, whether LRHS is centered, and the samples a pixel of LRHS and HRLS.
    """
    scale = config.scale
    is_centered = config.lrhs_sampling == ("centered",)
    if len(config.lrhs_sampling) == 2:
        is_centered = rng.random() < CENTERED_SHARE
    high = rng.choice(("0001", "0001", "0002", "0004", "0008"))
    low, parts = pick_lrhs(view, scale, high, is_centered, rng)
    y, x = (rng.randint(0, (side - size) // scale) * scale for side in view.read(high).shape[-2:])
    here = window(y, x, size)
    hrls = view.read(high)[:LAYER_CHANNELS][here]
    if view.guides() and rng.random() < GUIDES_SHARE:
        guides = view.read(rng.choice(view.guides()))[:6][here]
        hrls = torch.cat([hrls[:3], guides, hrls[9:]])
    if is_centered:
        lrhs, low_spp = view.read_lrhs(low, scale)
        lrhs = lrhs[window(*(n // scale for n in (y, x, size)))]
    else:
        y, x = (scale - 1 if is_mirrored else 0 for is_mirrored in mirrored)
        lrhs, low_spp = view.read(low)[:LAYER_CHANNELS][here][:, y::scale, x::scale], view.spp[low]
    first, last = (view.read(part)[:LAYER_CHANNELS][here] for part in (parts[0], parts[-1]))
    shares = [view.spp[part] / (view.spp[parts[0]] + view.spp[parts[-1]]) for part in (parts[0], parts[-1])]
    return lrhs, hrls, first, last, shares, is_centered, (float(low_spp), float(view.spp[high]))


def batch(views, config, size, count, seed):
    """Makes `count` random crops from a seed.

    Returns lrhs [N, 3, size/s, size/s], hrls [N, K, size, size], reference [N, 3, size, size], whether LRHS is centered
    [N, 1, 1, 1], and the samples a pixel of LRHS and HRLS [N, 2, 1, 1]; all but whether it is centered
    lie where the views are held.
    """
    rng = random.Random(seed)
    chosen = [rng.choice(views) for _ in range(count)]
    mirrored = [(rng.random() < 0.5, rng.random() < 0.5) for _ in chosen]
    crops = (crop(view, config, size, *rest, rng) for view, *rest in zip(chosen, mirrored))
    *images, shares, centered, spp = zip(*crops)
    lrhs, hrls, *parts = (torch.stack(image).float() for image in images)
    shares = on_each(shares, hrls)
    images = [hrls, parts[0].mul_(shares[:, :1]).add_(parts[1].mul_(shares[:, 1:])), lrhs]
    reweigh(images, rng)
    hrls, reference, lrhs = augment(images, mirrored, rng)
    exposure = on_each([2 ** rng.uniform(-1.5, 1.5) * view.exposure(config) for view in chosen], hrls)
    hrls[:, RADIANCE] *= exposure
    add_fireflies(hrls, rng)
    hrls = with_variance(hrls)
    drop_layers(hrls, config, rng)
    reference = reference[:, :3].clamp(0, TARGET_CLIP) * exposure
    return lrhs[:, :3] * exposure, hrls, reference, torch.tensor(centered).reshape(-1, 1, 1, 1), on_each(spp, hrls)


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
    return lrhs[None, :3], with_variance(hrls[None]), reference[None, :3] * exposure, exposure, spp

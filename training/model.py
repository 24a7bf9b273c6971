"""Defines the fusion network and the encoding of its inputs; names are those of the model file."""

import dataclasses
import math

import torch
import torch.nn.functional as F
from torch import nn

import safetensors

LAYERS = ("color", "albedo", "normal", "diffuse", "specular", "variance")
HALF_MAX = 65504.0
ALBEDO_FLOOR = 0.4
SPP_MOST = (256.0, 16.0)  # counts of LRHS and HRLS samples a pixel are clamped to these
# A pixel brighter than FIREFLY times the second brightest of its neighbours plus FIREFLY_FLOOR is a firefly.
FIREFLY, FIREFLY_FLOOR = 20.0, 1e-3


# These entries of the metadata belong to a pyramid network.
PYRAMID_ENTRIES = ("scale", "hrls_layers", "transfer", "clip", "lrhs_sampling", "optional_layers", "exposure_key")
PYRAMID_ENTRIES += ("lrhs_certainty", "knows_spp", "upscaled_features", "network", "widths")
UPSCALERS = ("edsr", "rcan")  # these networks read LRHS alone
EDSR_ENTRIES = ("scale", "features", "blocks", "transfer", "clip", "lrhs_sampling", "exposure_key", "network")
RCAN_ENTRIES = EDSR_ENTRIES + ("groups", "squeezed_features")
KPCN_ENTRIES = ("scale", "hrls_layers", "transfer", "clip", "optional_layers", "exposure_key", "features", "network")
KPCN_ENTRIES += ("depth", "kernel_side")
# These are not of the paper's network.
OF_OTHERS = ("network", "widths", "lrhs_certainty", "squeezed_features", "depth", "kernel_side")
OF_LRHS = ("lrhs_sampling", "lrhs_certainty")  # entries that a network without LRHS does not have


@dataclasses.dataclass
class Config:
    scale: int = 4
    features: int = 24
    growth: int = 16
    dense_layers: int = 3
    blocks: int = 2
    groups: int = 1
    hrls_layers: tuple = LAYERS
    long_skip: str = "lrhs"
    merge_relu: bool = False
    hrls_encoder: str = "full"
    hrls_kernel: int = 3
    upscale: str = "stages"
    upscaled_features: int = 0  # M; 0 stands for the value of features
    guide: str = "none"
    head_features: int = 0
    head_layers: int = 0
    transfer: str = "log"
    clip: float = 1000.0
    base: str = "bilinear"
    lrhs_certainty: float = 0.0  # a pyramid's
    lrhs_sampling: tuple = ("nearest",)
    optional_layers: tuple = ()
    exposure_key: float = 0.0
    knows_spp: bool = False
    network: str = "fusion"  # or "pyramid", "edsr", "rcan" or "kpcn"
    widths: tuple = ()  # the features of a pyramid's levels
    squeezed_features: int = 0  # channels inside of RCAN's attention
    depth: int = 0  # convolutions of each branch of KPCN
    kernel_side: int = 0  # the side of KPCN's kernels

    def __post_init__(self):
        self.upscaled_features = self.upscaled_features or self.features
        if self.network in UPSCALERS:
            self.hrls_layers = ()

    @property
    def reads_lrhs(self):
        """At a scale of 1 a network reads HRLS alone."""
        return self.scale > 1

    @property
    def reads_hrls(self):
        return bool(self.hrls_layers)

    @property
    def halvings(self):
        return int(math.log2(self.scale))

    def metadata(self):
        def text(value):
            if isinstance(value, tuple):
                return ",".join(value)
            if isinstance(value, bool):
                return "true" if value else "false"
            return f"{value:g}" if isinstance(value, float) else str(value)

        entries = {key: text(value) for key, value in dataclasses.asdict(self).items()}
        own = {"edsr": EDSR_ENTRIES, "rcan": RCAN_ENTRIES, "kpcn": KPCN_ENTRIES}
        if self.network in own:
            return {key: entries[key] for key in own[self.network]}
        if self.network == "pyramid":
            return {key: entries[key] for key in PYRAMID_ENTRIES if self.reads_lrhs or key not in OF_LRHS}
        return {key: value for key, value in entries.items() if key not in OF_OTHERS}

    @classmethod
    def parse(cls, metadata):
        """Inverts metadata(); it ignores entries that are not the network's and gives missing ones their default."""

        def value(field):
            text = metadata[field.name]
            kind = type(field.default)
            if kind is tuple:
                return tuple(text.split(",")) if text else ()
            return text == "true" if kind is bool else kind(text)

        return cls(**{field.name: value(field) for field in dataclasses.fields(cls) if field.name in metadata})


def transfer(x, kind):
    return torch.log1p(8 * x) / 3 if kind == "log" else x


def decode(y, kind):
    return (torch.expm1(3 * y) / 8 if kind == "log" else y).clamp(0, HALF_MAX)


def linear(color, config):
    """Returns radiance as the network reads it, in [0, clip]."""
    return torch.nan_to_num(color, nan=0.0, posinf=config.clip, neginf=0.0).clamp(0, config.clip)


def encode_layer(x, name, config):
    """Encodes one rendered layer [N, 3, H, W] as the network reads it."""
    low, high = {"albedo": (0, 1), "normal": (-1, 1)}.get(name, (0, config.clip))
    x = torch.nan_to_num(x, nan=0.0, posinf=high, neginf=low).clamp(low, high)
    return x if name in ("albedo", "normal") else transfer(x, config.transfer)


def encode(x, names, config):
    layers = x.split(3, dim=1)
    return torch.cat([encode_layer(layer, name, config) for layer, name in zip(layers, names, strict=True)], dim=1)


def variance(color):
    """Computes the population variance of each channel over 3x3 pixels; edges are replicated."""
    color = torch.nan_to_num(color, nan=0.0, posinf=0.0, neginf=0.0)
    height, width = color.shape[-2:]
    padded = F.pad(color, (1, 1, 1, 1), mode="replicate")
    near = [padded[..., dy : dy + height, dx : dx + width] for dy in range(3) for dx in range(3)]
    mean = sum(near) / 9
    return sum((n - mean) ** 2 for n in near) / 9


def bilinear(x, scale, phase=0.0):
    """Upsamples [N, C, h, w] to [N, C, s*h, s*w]; sample i sits at pixel s*i + phase, edges are replicated."""
    for axis in (-2, -1):
        size = x.shape[axis]
        u = ((torch.arange(size * scale, dtype=x.dtype, device=x.device) - phase) / scale).clamp(0, size - 1)
        left = u.floor().long()
        right = (left + 1).clamp(max=size - 1)
        weight = (u - left).reshape(-1, 1) if axis == -2 else u - left
        x = x.index_select(axis, left) * (1 - weight) + x.index_select(axis, right) * weight
    return x


def multiplied_in(x):
    """Returns the type in which a network multiplies x, which autocast on x's device chooses."""
    if x.device.type == "cpu":
        return torch.get_autocast_cpu_dtype() if torch.is_autocast_cpu_enabled() else x.dtype
    return torch.get_autocast_gpu_dtype() if torch.is_autocast_enabled() else x.dtype


def widened(y):
    """Returns what a network multiplied in 16 bits in 32."""
    return y.float() if y.dtype in (torch.bfloat16, torch.float16) else y


class Block(nn.Module):
    def __init__(self, config):
        super().__init__()
        c, r, count = config.features, config.growth, config.dense_layers
        self.dense = nn.ModuleList(nn.Conv2d(c + i * r, r, 3, padding=1) for i in range(count))
        self.merge = nn.Conv2d(c + count * r, c, 1)
        self.merge_relu = config.merge_relu

    def forward(self, x):
        features = x
        for conv in self.dense:
            features = torch.cat([features, F.relu(conv(features))], dim=1)
        merged = self.merge(features)
        return x + (F.relu(merged) if self.merge_relu else merged)


class Group(nn.Module):
    def __init__(self, config):
        super().__init__()
        self.blocks = nn.ModuleList(Block(config) for _ in range(config.blocks))

    def forward(self, x):
        y = x
        for block in self.blocks:
            y = block(y)
        return x + y


def residual_layers(widths):
    """Returns 3x3 convolutions of these widths. Each but the first adds to its input, at first only little."""
    layers = nn.ModuleList(nn.Conv2d(a, b, 3, padding=1) for a, b in zip(widths, widths[1:]))
    for conv in layers[1:]:
        conv.weight.data.mul_(0.1)
        nn.init.zeros_(conv.bias)
    return layers


def through(layers, y):
    for i, conv in enumerate(layers):
        y = F.relu(conv(y)) + (y if i else 0)
    return y


def conv(inputs, outputs, kernel=3):
    """Returns a convolution with random weights that keeps the size."""
    return nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2)


class Kept(nn.Module):
    """Keeps the output of each layer in the dictionary `outputs`, if there is one."""

    outputs = None

    def keep(self, name, y):
        if self.outputs is not None:
            self.outputs[name] = y
        return y


def create(config):
    """Returns the network that `config` describes, with random weights."""
    classes = {"fusion": Network, "pyramid": pyramid.Pyramid, "edsr": edsr.Edsr, "rcan": rcan.Rcan, "kpcn": kpcn.Kpcn}
    return classes[config.network](config)


def load(path):
    """Returns the network of a model file, with its weights in fp32."""
    tensors, metadata = safetensors.load(path)
    network = create(Config.parse(metadata))
    network.load_state_dict({key: torch.from_numpy(value.astype("float32")) for key, value in tensors.items()})
    return network.eval()


class Network(nn.Module):
    """Maps encoded lrhs [N, 3, h, w] and hrls [N, K, s*h, s*w] to the encoded image [N, 3, s*h, s*w]."""

    def __init__(self, config):
        super().__init__()
        self.config = config
        c, s, halvings = config.features, config.scale, config.halvings
        k, m = 3 * len(config.hrls_layers), config.upscaled_features
        self.lrhs = nn.Conv2d(3, c, 3, padding=1)
        if len(config.lrhs_sampling) == 2:
            self.lrhs.centered_bias = nn.Parameter(self.lrhs.bias.detach().clone())
        if config.hrls_encoder == "full":
            self.hrls = nn.Conv2d(k, c, 3, padding=1)
            self.down = nn.ModuleList(nn.Conv2d(4 * c, c, 3, padding=1) for _ in range(halvings))
        else:
            self.hrls = nn.Conv2d(k * s * s, c, config.hrls_kernel, padding=config.hrls_kernel // 2)
        if config.knows_spp:
            self.lrhs.by_spp, self.hrls.by_spp = (nn.Parameter(torch.zeros(c)) for _ in range(2))
        self.fuse = nn.Conv2d(2 * c, c, 1)
        self.groups = nn.ModuleList(Group(config) for _ in range(config.groups))
        if config.upscale == "stages":
            self.up = nn.ModuleList(nn.Conv2d(c, 4 * c, 3, padding=1) for _ in range(halvings))
        else:
            self.up = nn.ModuleList([nn.Conv2d(c, m * s * s, 3, padding=1)])
        last = m + (k if config.guide == "hrls" else 0)
        widths = [last] + [config.head_features] * config.head_layers
        self.head = residual_layers(widths)
        self.rec = nn.Conv2d(widths[-1], 3, 3, padding=1)
        if config.base != "none":
            nn.init.zeros_(self.rec.bias)
            self.rec.weight.data.mul_(0.1)

    def encode_hrls(self, hrls, spp):
        if self.config.hrls_encoder == "unshuffled":
            return F.relu(self.add_spp_bias(self.hrls(F.pixel_unshuffle(hrls, self.config.scale)), self.hrls, spp, 1))
        f_hrls = F.relu(self.add_spp_bias(self.hrls(hrls), self.hrls, spp, 1))
        for conv in self.down:
            f_hrls = F.relu(conv(F.pixel_unshuffle(f_hrls, 2)))
        return f_hrls

    def encode_lrhs(self, lrhs, centered, spp):
        y = self.add_spp_bias(self.lrhs(lrhs), self.lrhs, spp, 0)
        if len(self.config.lrhs_sampling) == 2:
            shift = (self.lrhs.centered_bias - self.lrhs.bias)[:, None, None]
            y = torch.where(centered, y + shift, y)
        return F.relu(y)

    def add_spp_bias(self, y, conv, spp, which):
        """Adds to `y` the bias by the samples of LRHS (`which` 0) or HRLS (1), if the network knows them."""
        if not self.config.knows_spp:
            return y
        return y + (conv.by_spp[:, None, None] * torch.log2(spp)[:, which, None]).to(y.dtype)

    def prepared(self, x):
        """Converts an input once; left to the layers, the conversions take a third of a training step."""
        return x.to(multiplied_in(x), memory_format=torch.channels_last)

    def trunk(self, f_lrhs, f_hrls):
        fused = F.relu(self.fuse(torch.cat([f_lrhs, f_hrls], dim=1)))
        y = fused
        for group in self.groups:
            y = group(y)
        return y + (f_lrhs if self.config.long_skip == "lrhs" else fused)

    def reconstruct(self, y, hrls):
        """Computes the image from the trunk's output `y` and from `hrls`, which the head reads at full size."""
        config = self.config
        for conv in self.up:
            y = F.pixel_shuffle(F.relu(conv(y)), config.scale if config.upscale == "direct" else 2)
        if config.guide == "hrls":
            y = torch.cat([y, hrls], dim=1)
        return widened(self.rec(through(self.head, y)))

    def forward(self, lrhs, hrls, centered=torch.tensor(False), spp=None):
        """Computes the output from encoded inputs.

        `centered`, one boolean or [N, 1, 1, 1], says that a sample of LRHS lies in the centre of the s x s pixels of
        HRLS that it covers. `spp` [1 or N, 2, 1, 1] holds the samples a pixel of LRHS and HRLS.
        """
        lrhs, hrls = self.prepared(lrhs), self.prepared(hrls)
        y = self.trunk(self.encode_lrhs(lrhs, centered, spp), self.encode_hrls(hrls, spp))
        return self.reconstruct(y, hrls)


def without_fireflies(color):
    """Darkens the fireflies of radiance [N, 3, H, W] to the limit that FIREFLY and FIREFLY_FLOOR set."""
    bright = luminance(color)[:, None]
    height, width = bright.shape[-2:]
    padded = F.pad(bright, [1] * 4)
    near = [padded[..., dy : dy + height, dx : dx + width] for dy in range(3) for dx in range(3) if (dy, dx) != (1, 1)]
    second = torch.cat(near, dim=1).topk(2, dim=1)[0][:, 1:]
    return color * ((FIREFLY * second + FIREFLY_FLOOR) / bright.clamp(min=FIREFLY_FLOOR)).clamp(max=1)


def predict(network, lrhs, hrls, centered=torch.tensor(False), exposure=1.0, spp=None):
    """Fuses lrhs [N, 3, h, w] and hrls [N, K, s*h, s*w], as rendered, to (encoded, scene linear) [N, 3, s*h, s*w].

    A network of scale 1 reads no `lrhs`; the color of HRLS takes its place. EDSR and RCAN read no `hrls`.
    `centered` and `spp` are those of Network.forward; by default a pixel of LRHS has as many samples as the s x s
    pixels of HRLS that it covers. `exposure` is the factor by which the inputs were multiplied. The linear image
    includes LRHS's radiance above the clip where it is near the clip itself.
    """
    config = network.config
    if not config.reads_lrhs:
        lrhs = hrls[:, :3]
    some_centered, centered = bool(centered.any()), centered.to((lrhs if config.reads_lrhs else hrls).device)
    if spp is None:
        spp = torch.tensor([config.scale**2, 1.0]).reshape(1, 2, 1, 1)
    spp = spp.clamp(min=1).minimum(torch.tensor(SPP_MOST).to(spp)[:, None, None]).to(lrhs)

    def upsampled(x):
        bases = [bilinear(x, config.scale)]
        if some_centered:
            bases.append(bilinear(x, config.scale, (config.scale - 1) / 2))
        return torch.where(centered, bases[-1], bases[0])

    if config.network in UPSCALERS:
        y = upscaler.predict(network, lrhs, upsampled)
    elif config.network == "kpcn":
        y = kpcn.predict(network, hrls)
    elif config.network == "pyramid":
        y = pyramid.predict(network, lrhs, hrls, upsampled, centered, spp)
    else:
        low = encode(lrhs, ("color",), config)
        y = network(low, encode(hrls, config.hrls_layers, config), centered, spp)
        if config.base == "bilinear":
            y = y + upsampled(low)
    fused = decode(y, config.transfer)
    beyond = torch.nan_to_num(lrhs - config.clip).clamp(0, HALF_MAX * exposure)
    return y, fused + (8 * fused / config.clip - 1).clamp(0, 1) * above_clip(beyond, upsampled)


def above_clip(beyond, upsampled):
    """Upsamples LRHS's radiance above the clip by the mean of four samples, each weighted by itself as well."""
    total = upsampled(beyond)
    return torch.where(total > 0, upsampled(beyond**2) / total, 0)


def luminance(color):
    """Computes the Rec. 709 luminance [..., H, W] of [..., 3, H, W]."""
    red, green, blue = color.unbind(-3)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def exposure(lrhs, config):
    """Returns the factor of radiance that brings the power mean of LRHS's luminance to exposure_key."""
    if not config.exposure_key:
        return 1.0
    color = torch.nan_to_num(lrhs, nan=0.0, posinf=HALF_MAX, neginf=0.0).clamp(0, HALF_MAX)
    mean = float(luminance(color).sqrt().mean()) ** 2
    return min(max(config.exposure_key / mean, 2.0**-24), 2.0**24) if mean > 0 else 1.0


import edsr  # noqa: E402, as it imports this module
import kpcn  # noqa: E402
import pyramid  # noqa: E402
import rcan  # noqa: E402
import upscaler  # noqa: E402

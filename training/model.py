"""The fusion network and the encoding of its inputs; names are those of the model file."""

import dataclasses
import math

import torch
import torch.nn.functional as F
from torch import nn

LAYERS = ("color", "albedo", "normal", "diffuse", "specular", "variance")
HALF_MAX = 65504.0


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
    transfer: str = "log"
    clip: float = 1000.0
    base: str = "bilinear"
    lrhs_sampling: str = "nearest"

    @property
    def halvings(self):
        return int(math.log2(self.scale))

    def metadata(self):
        values = dataclasses.asdict(self) | {"hrls_layers": ",".join(self.hrls_layers)}
        values["merge_relu"] = "true" if self.merge_relu else "false"
        return {key: f"{value:g}" if isinstance(value, float) else str(value) for key, value in values.items()}


def transfer(x, kind):
    return torch.log1p(8 * x) / 3 if kind == "log" else x


def decode(y, kind):
    return (torch.expm1(3 * y) / 8 if kind == "log" else y).clamp(0, HALF_MAX)


def encode_layer(x, name, config):
    """One layer [N, 3, H, W] as rendered -> what the network reads."""
    low, high = {"albedo": (0, 1), "normal": (-1, 1)}.get(name, (0, config.clip))
    x = torch.nan_to_num(x, nan=0.0, posinf=high, neginf=low).clamp(low, high)
    return x if name in ("albedo", "normal") else transfer(x, config.transfer)


def encode(x, names, config):
    layers = x.split(3, dim=1)
    return torch.cat([encode_layer(layer, name, config) for layer, name in zip(layers, names, strict=True)], dim=1)


def variance(color):
    """Population variance over 3x3 pixels, a channel at a time, edges replicated."""
    color = torch.nan_to_num(color, nan=0.0, posinf=0.0, neginf=0.0)
    height, width = color.shape[-2:]
    padded = F.pad(color, (1, 1, 1, 1), mode="replicate")
    near = [padded[..., dy : dy + height, dx : dx + width] for dy in range(3) for dx in range(3)]
    mean = sum(near) / 9
    return sum((n - mean) ** 2 for n in near) / 9


def bilinear(x, scale, phase=0.0):
    """[N, C, h, w] -> [N, C, s*h, s*w]; LR sample i sits at HR coordinate s*i + phase; edges replicated."""
    for axis in (-2, -1):
        size = x.shape[axis]
        u = ((torch.arange(size * scale, dtype=x.dtype) - phase) / scale).clamp(0, size - 1)
        left = u.floor().long()
        right = (left + 1).clamp(max=size - 1)
        weight = (u - left).reshape(-1, 1) if axis == -2 else u - left
        x = x.index_select(axis, left) * (1 - weight) + x.index_select(axis, right) * weight
    return x


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


class Network(nn.Module):
    """Encoded lrhs [N, 3, h, w] and hrls [N, K, s*h, s*w] -> encoded image [N, 3, s*h, s*w]."""

    def __init__(self, config):
        super().__init__()
        self.config = config
        c, halvings = config.features, config.halvings
        self.lrhs = nn.Conv2d(3, c, 3, padding=1)
        self.hrls = nn.Conv2d(3 * len(config.hrls_layers), c, 3, padding=1)
        self.down = nn.ModuleList(nn.Conv2d(4 * c, c, 3, padding=1) for _ in range(halvings))
        self.fuse = nn.Conv2d(2 * c, c, 1)
        self.groups = nn.ModuleList(Group(config) for _ in range(config.groups))
        self.up = nn.ModuleList(nn.Conv2d(c, 4 * c, 3, padding=1) for _ in range(halvings))
        self.rec = nn.Conv2d(c, 3, 3, padding=1)
        if config.base == "bilinear":
            nn.init.zeros_(self.rec.bias)
            self.rec.weight.data.mul_(0.1)

    def forward(self, lrhs, hrls):
        f_lrhs = F.relu(self.lrhs(lrhs))
        f_hrls = F.relu(self.hrls(hrls))
        for conv in self.down:
            f_hrls = F.relu(conv(F.pixel_unshuffle(f_hrls, 2)))
        fused = F.relu(self.fuse(torch.cat([f_lrhs, f_hrls], dim=1)))
        y = fused
        for group in self.groups:
            y = group(y)
        y = y + (f_lrhs if self.config.long_skip == "lrhs" else fused)
        for conv in self.up:
            y = F.pixel_shuffle(F.relu(conv(y)), 2)
        return self.rec(y)


def predict(network, lrhs, hrls):
    """As rendered, lrhs [N, 3, h, w] and hrls [N, K, s*h, s*w] -> (encoded, scene linear) image [N, 3, s*h, s*w]."""
    config = network.config
    lrhs = encode(lrhs, ("color",), config)
    y = network(lrhs, encode(hrls, config.hrls_layers, config))
    if config.base == "bilinear":
        y = y + bilinear(lrhs, config.scale)
    return y, decode(y, config.transfer)

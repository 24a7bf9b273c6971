"""Defines RCAN (Zhang et al. 2018); see docs/model-format.md."""

import torch
import torch.nn.functional as F
from torch import nn

from model import conv
from upscaler import Upscaler


class Block(nn.ModuleDict):
    """A residual block whose channels are scaled by attention to their means."""

    def __init__(self, features, squeezed):
        parts = {"0": conv(features, features), "1": conv(features, features)}
        super().__init__(parts | {"squeeze": conv(features, squeezed, 1), "excite": conv(squeezed, features, 1)})

    def forward(self, keep, name, x):
        inner = keep(f"{name}.1", self["1"](keep(f"{name}.0", F.relu(self["0"](x)))))
        means = keep(f"{name}.means", inner.mean(dim=(2, 3), keepdim=True))
        logits = keep(f"{name}.excite", self["excite"](keep(f"{name}.squeeze", F.relu(self["squeeze"](means)))))
        return keep(f"{name}.attend", torch.sigmoid(logits) * inner + x)


class Group(nn.Module):
    def __init__(self, config):
        super().__init__()
        self.blocks = nn.ModuleList(Block(config.features, config.squeezed_features) for _ in range(config.blocks))
        self.last = conv(config.features, config.features)

    def forward(self, keep, name, x):
        inner = x
        for i, block in enumerate(self.blocks):
            inner = block(keep, f"{name}.blocks.{i}", inner)
        return keep(f"{name}.last", x + self.last(inner))


class Rcan(Upscaler):
    def add_trunk(self, config):
        self.groups = nn.ModuleList(Group(config) for _ in range(config.groups))

    def trunk(self, x):
        for i, group in enumerate(self.groups):
            x = group(self.keep, f"groups.{i}", x)
        return x

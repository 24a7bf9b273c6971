"""Defines EDSR (Lim et al. 2017); see docs/model-format.md."""

import torch.nn.functional as F
from torch import nn

from model import conv
from upscaler import Upscaler


class Edsr(Upscaler):
    def add_trunk(self, config):
        c = config.features
        self.blocks = nn.ModuleList(nn.ModuleList((conv(c, c), conv(c, c))) for _ in range(config.blocks))
        for _, last in self.blocks:
            last.weight.data.mul_(0.1)  # the paper's residual scaling

    def trunk(self, x):
        for i, (first, last) in enumerate(self.blocks):
            inner = self.keep(f"blocks.{i}.0", F.relu(first(x)))
            x = self.keep(f"blocks.{i}.1", x + last(inner))
        return x

"""Defines EDSR (Lim et al. 2017), which upscales LRHS alone; see docs/model-format.md."""

import torch
import torch.nn.functional as F
from torch import nn

import model


def conv(inputs, outputs):
    return nn.Conv2d(inputs, outputs, 3, padding=1)


class Edsr(model.Kept):
    """Maps encoded LRHS [N, 3, h, w] to the encoded image less the upsampled LRHS [N, 3, s*h, s*w]."""

    def __init__(self, config):
        super().__init__()
        self.config = config
        c = config.features
        self.head = conv(3, c)
        self.blocks = nn.ModuleList(nn.ModuleList((conv(c, c), conv(c, c))) for _ in range(config.blocks))
        self.body = conv(c, c)
        self.up = nn.ModuleList(conv(c, 4 * c) for _ in range(config.halvings))
        self.rec = conv(c, 3)
        for _, last in self.blocks:
            last.weight.data.mul_(0.1)  # the paper's residual scaling
        self.rec.weight.data.mul_(0.1)

    def forward(self, low):
        head = x = self.keep("head", self.head(low))
        for i, (first, last) in enumerate(self.blocks):
            inner = self.keep(f"blocks.{i}.0", F.relu(first(x)))
            x = self.keep(f"blocks.{i}.1", x + last(inner))
        x = self.keep("body", head + self.body(x))
        for i, up in enumerate(self.up):
            x = self.keep(f"up.{i}", F.pixel_shuffle(up(x), 2))
        return model.widened(self.keep("rec", self.rec(x)))


def predict(network, lrhs, upsampled):
    """Computes the encoded image of model.predict()."""
    low = model.encode(lrhs, ("color",), network.config)
    return network(low.to(model.multiplied_in(low))) + upsampled(low)

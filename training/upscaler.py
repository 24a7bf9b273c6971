"""Has what networks share that upscale LRHS alone: EDSR and RCAN; see docs/model-format.md."""

import torch.nn.functional as F
from torch import nn

import model
from model import conv


class Upscaler(model.Kept):
    """Maps encoded LRHS [N, 3, h, w] to the encoded image less the upsampled LRHS [N, 3, s*h, s*w].

    A subclass has add_trunk(config), which makes its layers, and trunk(x) -> [N, C, h, w].
    """

    def __init__(self, config):
        super().__init__()
        self.config = config
        c = config.features
        self.head = conv(3, c)
        self.add_trunk(config)
        self.body = conv(c, c)
        self.up = nn.ModuleList(conv(c, 4 * c) for _ in range(config.halvings))
        self.rec = conv(c, 3)
        self.rec.weight.data.mul_(0.1)

    def forward(self, low):
        head = self.keep("head", self.head(low))
        x = self.keep("body", head + self.body(self.trunk(head)))
        for i, up in enumerate(self.up):
            x = self.keep(f"up.{i}", F.pixel_shuffle(up(x), 2))
        return model.widened(self.keep("rec", self.rec(x)))


def predict(network, lrhs, upsampled):
    """Computes the encoded image of model.predict()."""
    low = model.encode(lrhs, ("color",), network.config)
    return network(low.to(model.multiplied_in(low))) + upsampled(low)

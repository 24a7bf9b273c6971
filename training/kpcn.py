"""Defines KPCN (Bako et al. 2017), which denoises HRLS; see docs/model-format.md."""

import torch
import torch.nn.functional as F
from torch import nn

import model
import pyramid
from kernel_filter import kernel_filter

KERNEL = 5
BRANCHES = ("diffuse", "rest")


def gradients(x):
    """Returns the differences to the next pixel along x, and then along y."""
    along_x, along_y = x[..., 1:] - x[..., :-1], x[..., 1:, :] - x[..., :-1, :]
    return torch.cat([F.pad(along_x, (0, 1)), F.pad(along_y, (0, 0, 0, 1))], dim=1)


class Kpcn(model.Kept):
    """Maps inputs [N, 3 (K + 6), H, W] to the logits of a kernel for each branch [N, side^2, H, W]."""

    def __init__(self, config):
        super().__init__()
        self.config = config
        inputs, c = 3 * (3 * len(config.hrls_layers) + 6), config.features

        for branch in BRANCHES:
            layers = [model.conv(c if i else inputs, c, KERNEL) for i in range(config.depth - 1)]
            setattr(self, branch, nn.ModuleList(layers))
        self.kernel = nn.ModuleDict({branch: model.conv(c, config.kernel_side**2, KERNEL) for branch in BRANCHES})

    def forward(self, inputs):
        inputs = inputs.to(model.multiplied_in(inputs), memory_format=torch.channels_last)
        logits = []
        for branch in BRANCHES:
            x = inputs
            for i, layer in enumerate(getattr(self, branch)):
                x = self.keep(f"{branch}.{i}", F.relu(layer(x)))
            logits.append(model.widened(self.keep(f"kernel.{branch}", self.kernel[branch](x))))
        return logits


def predict(network, hrls):
    """Computes the encoded image of model.predict()."""
    config, keep = network.config, network.keep
    high = model.encode(hrls, config.hrls_layers, config)
    color, albedo, _, diffuse = high[:, :12].split(3, dim=1)
    diffuse = model.decode(diffuse, config.transfer)
    floored = albedo + model.ALBEDO_FLOOR
    light = keep("light", pyramid.compressed(model.without_fireflies(diffuse) / floored))
    rest = (model.decode(color, config.transfer) - diffuse).clamp(min=0)
    rest = keep("remainder", model.transfer(rest, config.transfer))
    images = torch.cat([high, light, rest], dim=1)
    inputs = torch.cat([images, keep("gradients", gradients(images))], dim=1)
    of_light, of_rest = network(inputs)
    light = keep("filter.diffuse", kernel_filter(light, of_light))
    rest = keep("filter.rest", kernel_filter(rest, of_rest))
    radiance = pyramid.expanded(light) * floored + model.decode(rest, config.transfer)
    return keep("remodulate", model.transfer(radiance, config.transfer))

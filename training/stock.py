"""The stock models: x{2,4,8}-{full,balanced,fast}, and single-input versions of them for comparison."""

import dataclasses

from model import LAYERS, Config

ROBUST = dict(
    lrhs_sampling=("nearest", "centered"),
    optional_layers=("albedo", "normal", "diffuse", "specular"),
    exposure_key=0.18,
    clip=100.0,
)
# Nothing but a small head runs at full size.
LIGHT = ROBUST | dict(hrls_encoder="unshuffled", upscale="direct", upscaled_features=16, guide="hrls", head_features=16)
# features, growth, dense_layers, blocks, groups
SIZES = {
    "full": ((64, 64, 4, 5, 3), ROBUST),
    "balanced": ((48, 32, 4, 3, 2), LIGHT),
    "fast": ((24, 16, 3, 2, 1), LIGHT),
}


def config(name):
    """The Config of a stock model's name."""
    scale, size = name.removeprefix("x").split("-")
    shape, choices = SIZES[size]
    return Config(int(scale), *shape, **choices)


def rgb_only(config):
    return dataclasses.replace(config, hrls_layers=("color", "variance"), optional_layers=())


def names():
    return [f"x{scale}-{size}" for scale in (2, 4, 8) for size in SIZES]


assert set(ROBUST["optional_layers"]) < set(LAYERS)

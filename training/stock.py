"""The stock models: x{2,4,8}-{full,balanced,fast}."""

from model import Config

CHOICES = dict(
    # Nothing but a small head runs at full size.
    hrls_encoder="unshuffled",
    upscale="direct",
    upscaled_features=16,
    guide="hrls",
    head_features=16,
    # What users feed.
    lrhs_sampling=("nearest", "centered"),
    optional_layers=("albedo", "normal", "diffuse", "specular"),
    exposure_key=0.18,
    base="joint",
    clip=100.0,
)
# features, growth, dense_layers, blocks, groups; full has the trunk of Hou et al. 2021.
SIZES = {"full": (64, 64, 4, 5, 3), "balanced": (48, 32, 4, 3, 2), "fast": (24, 16, 3, 2, 1)}


def config(name):
    """The Config of a stock model's name."""
    scale, size = name.removeprefix("x").split("-")
    return Config(int(scale), *SIZES[size], **CHOICES)


def names():
    return [f"x{scale}-{size}" for scale in (2, 4, 8) for size in SIZES]


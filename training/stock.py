"""Defines the stock models x{2,4}-{full,balanced,fast,faster}."""

from model import Config

CHOICES = dict(
    # Nothing but a small head runs at full size.
    hrls_encoder="unshuffled",
    upscaled_features=16,
    guide="hrls",
    hrls_kernel=3,
    head_layers=2,
    # These describe the inputs that users have.
    lrhs_sampling=("centered", "nearest"),
    optional_layers=("albedo", "normal", "diffuse", "specular"),
    exposure_key=0.18,
    knows_spp=True,
    base="joint",
    clip=100.0,
)
FASTER = dict(hrls_kernel=1, head_layers=1)
HALF = dict(upscale="half", half_features=16, half_layers=2)  # gains nothing in x4-balanced
# A size is features, growth, dense_layers, blocks, groups, head_features; full has the trunk of Hou et al. 2021.
FAST = (24, 16, 3, 2, 1, 16)
SIZES = {"full": (64, 64, 4, 5, 3, 48), "balanced": (48, 32, 4, 3, 2, 32), "fast": FAST, "faster": FAST}


def config(name, changes=()):
    """Returns the Config of a stock model by its name, with metadata entries changed, ENTRY=VALUE each."""
    scale, size = name.removeprefix("x").split("-")
    scale, (*trunk, head_features) = int(scale), SIZES[size]
    choices = CHOICES | (FASTER if size == "faster" else {})
    choices |= HALF if (scale, size) == (4, "fast") else dict(upscale="direct")
    # A pixel of LRHS has as many samples as the s x s pixels of HRLS that it covers.
    stock = Config(scale, *trunk, **choices, head_features=head_features, lrhs_certainty=float(scale**2))
    return Config.parse(stock.metadata() | dict(change.split("=") for change in changes))


def names():
    return [f"x{scale}-{size}" for scale in (2, 4) for size in SIZES]


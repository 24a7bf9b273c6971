"""Defines the stock models x{2,4}-{full,balanced,fast}, denoise-{balanced,kpcn} and x{2,4}-{edsr,rcan}.

Those that denoise read HRLS alone, and those of EDSR and RCAN read LRHS alone.
"""

from model import Config

CHOICES = dict(
    # Nothing but a small head runs at full size.
    hrls_encoder="unshuffled",
    upscaled_features=16,
    upscale="direct",
    guide="hrls",
    hrls_kernel=3,
    head_layers=2,
    base="joint",
)
# These describe the inputs that users have.
INPUTS = dict(
    lrhs_sampling=("centered", "nearest"),
    optional_layers=("albedo", "normal", "diffuse", "specular"),
    exposure_key=0.18,
    knows_spp=True,
    clip=100.0,
)
# A size is features, growth, dense_layers, blocks, groups, head_features; full has the trunk of Hou et al. 2021.
SIZES = {"full": (64, 64, 4, 5, 3, 48), "balanced": (48, 32, 4, 3, 2, 32), "fast": (24, 16, 3, 2, 1, 16)}
# These are pyramid networks: the features of their levels, and of the full size.
BALANCED = dict(widths=("48", "64", "80", "96"), upscaled_features=24)
PYRAMIDS = {
    "denoise-balanced": BALANCED,
    "x2-balanced": BALANCED,
    "x4-fast": dict(widths=("24", "32", "48", "64"), upscaled_features=16),
}
KPCN = dict(features=24, depth=5, kernel_side=11)
# EDSR and RCAN have as many residual blocks.
UPSCALERS = {
    "edsr": dict(features=32, blocks=16),
    "rcan": dict(features=32, blocks=4, groups=4, squeezed_features=4),
}


def config(name, changes=()):
    """Returns the Config of a stock model by its name, with metadata entries changed, ENTRY=VALUE each."""
    kind, size = name.split("-")
    scale = 1 if kind == "denoise" else int(kind[1:])
    certainty = float(scale**2)  # a pixel of LRHS has as many samples as the s x s pixels of HRLS that it covers
    if size in UPSCALERS:
        inputs = dict(lrhs_sampling=("centered",), exposure_key=0.18, clip=100.0)
        stock = Config(scale, **UPSCALERS[size], **inputs, network=size)
    elif size == "kpcn":
        inputs = {key: INPUTS[key] for key in ("optional_layers", "exposure_key", "clip")}
        stock = Config(1, **KPCN, **inputs, network="kpcn")
    elif scale == 1:
        inputs = {key: value for key, value in INPUTS.items() if key != "lrhs_sampling"}
        stock = Config(scale, **inputs, **PYRAMIDS[name], network="pyramid")
    elif name in PYRAMIDS:
        stock = Config(scale, **INPUTS, **PYRAMIDS[name], network="pyramid", lrhs_certainty=certainty)
    else:
        *trunk, head_features = SIZES[size]
        stock = Config(scale, *trunk, **CHOICES, **INPUTS, head_features=head_features, lrhs_certainty=certainty)
    return Config.parse(stock.metadata() | dict(change.split("=") for change in changes))


def names():
    with_lrhs = [f"x{scale}-{size}" for scale in (2, 4) for size in (*SIZES, *UPSCALERS)]
    return [*with_lrhs, "denoise-balanced", "denoise-kpcn"]


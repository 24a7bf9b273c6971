"""Defines the stock models x{2,4}-{full,balanced,fast}, denoise-{balanced,kpcn} and x{2,4}-{edsr,rcan}.

Those that denoise read HRLS alone, and those of EDSR and RCAN read LRHS alone.
"""

from model import Config

# The network of Hou et al. 2021 has their trunk, and nothing but a small head runs at full size.
FULL = dict(
    features=64,
    growth=64,
    dense_layers=4,
    blocks=5,
    groups=3,
    hrls_encoder="unshuffled",
    upscaled_features=16,
    upscale="direct",
    guide="hrls",
    hrls_kernel=3,
    head_features=48,
    head_layers=2,
)
# These describe the inputs that users have.
INPUTS = dict(
    lrhs_sampling=("centered", "nearest"),
    optional_layers=("albedo", "normal", "diffuse", "specular"),
    exposure_key=0.18,
    knows_spp=True,
    clip=100.0,
)
# These are the sizes of pyramid networks: the features of their levels, and of the full size.
PYRAMIDS = {
    "balanced": dict(widths=("48", "64", "80", "96"), upscaled_features=24),
    "fast": dict(widths=("24", "32", "48", "64"), upscaled_features=16),
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
    if size in UPSCALERS:
        inputs = dict(lrhs_sampling=("centered",), exposure_key=0.18, clip=100.0)
        stock = Config(scale, **UPSCALERS[size], **inputs, network=size)
    elif size == "kpcn":
        inputs = {key: INPUTS[key] for key in ("optional_layers", "exposure_key", "clip")}
        stock = Config(1, **KPCN, **inputs, network="kpcn")
    elif size == "full":
        stock = Config(scale, **FULL, **INPUTS)
    else:
        # A pixel of LRHS has as many samples as the s x s pixels of HRLS that it covers.
        stock = Config(scale, **INPUTS, **PYRAMIDS[size], lrhs_certainty=float(scale**2), network="pyramid")
    return Config.parse(stock.metadata() | dict(change.split("=") for change in changes))


def names():
    with_lrhs = [f"x{scale}-{size}" for scale in (2, 4) for size in ("full", *PYRAMIDS, *UPSCALERS)]
    return [*with_lrhs, "denoise-balanced", "denoise-kpcn"]

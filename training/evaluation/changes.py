"""Defines the changes that can be made to a pair of renders before fusion."""

import dataclasses
from typing import Callable

import numpy

FIREFLY_SHARE, FIREFLY_GAIN = 1e-3, 1000
EXPOSURES = (-8, -4, 4, 8)  # stops


@dataclasses.dataclass(frozen=True)
class Change:
    """Holds a change: apply(lrhs, hrls, scale) changes both Exr in place; the fused image is multiplied by `gain`.

    `centered` says that the changed LRHS is an ordinary small render.
    """

    apply: Callable
    gain: float = 1.0
    centered: bool = False


def is_radiance(layer):
    return layer == "Combined" or layer.endswith(("Dir", "Ind"))


def radiance(exr):
    return [i for i in exr.indices(is_radiance) if not exr.channels[i].endswith(".A")]


def exposed(stops):
    def apply(lrhs, hrls, scale):
        for exr in (lrhs, hrls):
            exr.pixels[..., radiance(exr)] *= 2.0**stops

    return Change(apply, gain=2.0**-stops)


def fireflies(lrhs, hrls, scale):
    struck = numpy.random.default_rng(1).random(hrls.pixels.shape[:2]) < FIREFLY_SHARE
    gain = numpy.where(struck, FIREFLY_GAIN, 1).astype("float32")
    hrls.pixels[..., radiance(hrls)] *= gain[..., None]


def alpha(lrhs, hrls, scale):
    """Replaces alpha by a ramp from 0 to 1; the colour stays as it is, so the fused one must."""
    index = [i for i, name in enumerate(hrls.channels) if name.endswith("Combined.A")]
    hrls.pixels[..., index] = numpy.linspace(0, 1, hrls.pixels.shape[1], dtype="float32")[:, None]


def rgb(lrhs, hrls, scale):
    hrls.pixels[..., hrls.indices(lambda layer: layer != "Combined")] = 0


def no_hrls(lrhs, hrls, scale):
    hrls.pixels[:] = 0


def no_lrhs(lrhs, hrls, scale):
    """Blanks LRHS. The program then takes 1 for the exposure, which is within the range that models are trained for."""
    lrhs.pixels[:] = 0


def subsampled(lrhs, hrls, scale):
    """Takes every scale-th pixel of LRHS, which is a full-size image."""
    lrhs.pixels = lrhs.pixels[::scale, ::scale]


def averaged(lrhs, hrls, scale):
    """Averages LRHS, which is a full-size image, over scale x scale pixels."""
    height, width, channels = lrhs.pixels.shape
    divided = lrhs.pixels.reshape(height // scale, scale, width // scale, scale, channels)
    lrhs.pixels = divided.mean(axis=(1, 3))


CHANGES = {
    "averaged": Change(averaged, centered=True),
    "fireflies": Change(fireflies),
    "alpha": Change(alpha),
    "rgb": Change(rgb),
    "no-hrls": Change(no_hrls),
    "no-lrhs": Change(no_lrhs),
    "subsampled": Change(subsampled),
} | {f"exposure {stops:+}": exposed(stops) for stops in EXPOSURES}

"""Makes pairs of renders that a network may be given, easy and hard: a crop of a real pair and changes of it."""

import dataclasses
import functools
from typing import Callable

import numpy

from evaluation.changes import radiance
from evaluation.images import Exr

SIZE = 128  # side of the crop, in pixels of HRLS
ORIGIN = 256, 192  # row and column, multiples of every scale; the crop has edges, texture, a highlight, a shadow
LAMP = SIZE // 8  # side of the painted square
FLT_MAX = float(numpy.finfo("float32").max)
# STOPS are exposures, as powers of two.
STOPS = (-20, -10, 10, 20)


@dataclasses.dataclass(frozen=True)
class InputClass:
    """Holds a class of inputs: apply(lrhs, hrls, scale) changes both Exr in place.

    `gain` brings the fused image back to the reference. Without a gain, the reference says nothing about the image.
    """

    name: str
    apply: Callable
    gain: float = None


def scaled(factor):
    def apply(lrhs, hrls, scale):
        for exr in (lrhs, hrls):
            exr.pixels[..., radiance(exr)] *= factor

    return apply


def region(exr, side):
    """Returns the pixels in the middle, [side, side, C]."""
    first = (exr.pixels.shape[0] - side) // 2
    return exr.pixels[first : first + side, first : first + side]


def paint(exr, side, value):
    region(exr, side)[..., radiance(exr)] = value


def firefly(value):
    """Returns a change that paints one pixel of HRLS."""
    return lambda lrhs, hrls, scale: paint(hrls, 1, value)


def lamp(value):
    """Returns a change that paints a square of both renders."""

    def apply(lrhs, hrls, scale):
        paint(lrhs, LAMP // scale, value)
        paint(hrls, LAMP, value)

    return apply


def in_turn(*changes):
    def apply(lrhs, hrls, scale):
        for change in changes:
            change(lrhs, hrls, scale)

    return apply


def layer(name, change):
    """Returns a change that replaces the pixels of HRLS's layer `name` by change(pixels)."""

    def apply(lrhs, hrls, scale):
        index = hrls.indices(lambda layer: layer == name)
        hrls.pixels[..., index] = change(hrls.pixels[..., index])

    return apply


def fill(exr, colour):
    """Fills a render with radiance of `colour` [H, W, 1] on a grey wall that faces the camera."""
    exr.pixels[:] = 0.5
    exr.pixels[..., exr.indices(lambda layer: layer == "Denoising Normal")] = 0
    exr.pixels[..., [i for i, name in enumerate(exr.channels) if name.endswith((".Z", ".A"))]] = 1
    exr.pixels[..., radiance(exr)] = colour


def constant(lrhs, hrls, scale):
    for exr in (lrhs, hrls):
        fill(exr, 0.5)


def checkerboard(lrhs, hrls, scale):
    """Alternates 0 and 1 pixel by pixel, in each render by its own pixels."""
    for exr in (lrhs, hrls):
        height, width = exr.pixels.shape[:2]
        fill(exr, ((numpy.arange(height)[:, None] + numpy.arange(width)) % 2)[..., None])


def black(lrhs, hrls, scale):
    for exr in (lrhs, hrls):
        exr.pixels[:] = 0


def disagree(lrhs, hrls, scale):
    """Turns LRHS upside down: its brightness stays, but it shows another picture."""
    lrhs.pixels = numpy.ascontiguousarray(lrhs.pixels[::-1])


def alpha(lrhs, hrls, scale):
    hrls.pixels[..., [i for i, name in enumerate(hrls.channels) if name.endswith("Combined.A")]] = 0


CLASSES = [
    InputClass("as rendered", in_turn(), 1.0),
    *(InputClass(f"exposure 2^{stops}", scaled(2.0**stops), 2.0**-stops) for stops in STOPS),
    InputClass("all zero", black),
    InputClass("constant", constant),
    InputClass("checkerboard", checkerboard),
    InputClass("times 1e-30", scaled(1e-30)),
    InputClass("denormals", scaled(2.0**-130)),
    InputClass("firefly 1e4", firefly(1e4), 1.0),
    InputClass("firefly 1e8", firefly(1e8), 1.0),
    InputClass("dark, firefly 1e4", in_turn(scaled(2.0**-10), firefly(1e4)), 2.0**10),
    InputClass("dark, firefly 1e8", in_turn(scaled(2.0**-10), firefly(1e8)), 2.0**10),
    InputClass("lamp 65504", lamp(65504)),
    InputClass("lamp 65520", lamp(65520)),
    InputClass("lamp 1e8", lamp(1e8)),
    InputClass("lamp 1e30", lamp(1e30)),
    InputClass("lamp FLT_MAX", lamp(FLT_MAX)),
    InputClass("negative", lamp(-1)),
    InputClass("minus zero", lamp(-0.0)),
    InputClass("all negative", scaled(-1)),
    InputClass("one NaN", firefly(numpy.nan), 1.0),
    InputClass("square of NaN", lamp(numpy.nan)),
    InputClass("one Inf", firefly(numpy.inf), 1.0),
    InputClass("square of Inf", lamp(numpy.inf)),
    InputClass("alpha 0", alpha, 1.0),
    InputClass("albedo 0", layer("Denoising Albedo", lambda x: 0 * x), 1.0),
    InputClass("albedo times 4", layer("Denoising Albedo", lambda x: 4 * x), 1.0),
    InputClass("normals times 3", layer("Denoising Normal", lambda x: 3 * x), 1.0),
    InputClass("normals times 1e-3", layer("Denoising Normal", lambda x: 1e-3 * x), 1.0),
    InputClass("renders disagree", disagree),
]
BY_NAME = {one.name: one for one in CLASSES}
# Models that are not measured with all classes are measured with these.
HARDEST = ("as rendered", "exposure 2^-20", "exposure 2^20", "all zero", "checkerboard", "firefly 1e8", "lamp 65504")
HARDEST += ("lamp 65520", "lamp 1e8", "lamp 1e30", "lamp FLT_MAX", "square of NaN", "square of Inf", "renders disagree")


@functools.cache
def crop(path, scale=1):
    """Returns the crop of an image at 1/scale of HRLS's size. It is cached, so it must not be changed."""
    exr = Exr.read(path)
    top, left = (value // scale for value in ORIGIN)
    return Exr(exr.channels, exr.pixels[top : top + SIZE // scale, left : left + SIZE // scale].copy())


def pair(data, scale, name):
    """Returns (LRHS, HRLS) of a class."""
    crops = crop(data / f"lrhs-x{scale}.exr", scale), crop(data / "hrls.exr")
    lrhs, hrls = (Exr(one.channels, one.pixels.copy()) for one in crops)
    with numpy.errstate(over="ignore", invalid="ignore"):
        BY_NAME[name].apply(lrhs, hrls, scale)
    return lrhs, hrls

"""Filters a plain render by first-order regression, after Bitterli et al. 2016.

Bitterli et al., Nonlinearly Weighted First-order Regression for Denoising Monte Carlo Renderings. Theirs reads two
halves of the samples, which renders do not hold, and blends two bandwidths by errors that the halves show. This one has
one bandwidth, and estimates variance from neighbours on the same surface.
"""

import ctypes
import dataclasses
import pathlib

import numpy
import torch

import compiled
from compiled import pointer
from evaluation.baselines import (
    LUMINANCE,
    compressed,
    expanded,
    noise_variance,
    scaled_guides,
    shifted,
    squared_distance,
    window,
    without_fireflies,
)

RADIUS = 9  # that of the window
PATCH = 3  # radius of the patches whose distance weights a pixel
RIDGE = 1e-3  # keeps the fits regular where features do not vary


@dataclasses.dataclass(frozen=True)
class Nfor:
    """Holds the parameters of nfor()."""

    color: float  # k of the weights by patches of Rousselle et al. 2012
    compress: float  # c; log(1 + c x) / c is filtered
    albedo_floor: float
    normal: float  # widths of the weights by guides
    albedo: float
    alike: float  # noisy guides are averaged first, over pixels that differ by so many of these widths
    firefly: float  # a pixel is at most this many times as bright as the second brightest around it


def boxed(image, radius):
    """Computes the mean over a square around each pixel of [H, W], with replicated edges."""
    planes = torch.from_numpy(image)[None, None]
    padded = torch.nn.functional.pad(planes, [radius] * 4, mode="replicate")
    return torch.nn.functional.avg_pool2d(padded, 2 * radius + 1, stride=1)[0, 0].numpy()


def averaged(guides, width):
    """Averages guides over 7x7 pixels, weighted by how alike these are."""
    total, weights = 0, 0
    for d in window(3):
        weight = numpy.exp(-squared_distance(guides, *d) / width**2)[..., None]
        total, weights = total + weight * shifted(guides, *d), weights + weight
    return total / weights


def patch_weights(luminance, guides, p):
    """Yields for each pixel of the window the weight [H, W] of the pixel there."""
    variance = noise_variance(luminance, lambda dy, dx: numpy.exp(-squared_distance(guides, dy, dx))) + 1e-6
    for d in window(RADIUS):
        near = shifted(variance, *d)
        difference = (shifted(luminance, *d) - luminance) ** 2 - (variance + numpy.minimum(variance, near))
        distance = boxed(difference / (p.color**2 * (variance + near)), PATCH).clip(0)
        yield numpy.exp(-distance - squared_distance(guides, *d))


def regression(x, features, weights):
    """Fits and averages as nfor.cpp's regress() does: x [H, W, 3], features [H, W, 6], weights [window, H, W]."""
    images = [torch.as_tensor(image, dtype=torch.float32).contiguous() for image in (x, features, weights)]
    out = torch.empty_like(images[0])
    radius = int(len(weights) ** 0.5) // 2
    library = compiled.library(pathlib.Path(__file__).with_suffix(".cpp"))
    library.regress(*map(pointer, images), *x.shape[:2], radius, ctypes.c_float(RIDGE), pointer(out))
    return out.numpy()


def nfor(color, albedo, normal, p):
    """Filters `color`; all images are scene linear [H, W, 3]."""
    guides = averaged(scaled_guides(albedo, normal, p), p.alike)
    texture = guides[..., :3] * p.albedo + p.albedo_floor
    x = compressed(without_fireflies(color, p.firefly) / texture, p).astype(numpy.float32)
    weights = numpy.empty(((2 * RADIUS + 1) ** 2, *x.shape[:2]), numpy.float32)
    for plane, weight in zip(weights, patch_weights(x @ LUMINANCE, guides, p)):
        plane[:] = weight
    return expanded(regression(x, guides, weights).clip(0), p) * texture

"""Writes the PNG files of docs/quality.md."""

import matplotlib
import numpy
import torch

import loss
from evaluation.jobs import Job
from evaluation.tables import base, first_lead, rival
from evaluation.test_set import PAIRS, render

matplotlib.use("Agg")
from matplotlib import pyplot

CROP, ENLARGED = 96, 3


def srgb(image):
    return loss.srgb(torch.from_numpy(numpy.ascontiguousarray(image))).numpy()


def worst_crops(images, image):
    """Returns the CROP x CROP pixels in which images[image] is farthest from the last image, enlarged, side by side.

    The images are in sRGB, and the pixels begin on a grid of half their size.
    """
    error = ((images[image] - images[-1]) ** 2).sum(-1)
    ys, xs = (range(0, size - CROP + 1, CROP // 2) for size in error.shape)
    y, x = max(((y, x) for y in ys for x in xs), key=lambda s: error[s[0] : s[0] + CROP, s[1] : s[1] + CROP].sum())
    row = numpy.concatenate([image[y : y + CROP, x : x + CROP] for image in images], axis=1)
    return row.repeat(ENLARGED, 0).repeat(ENLARGED, 1)


def crops(model, view, program):
    """Returns bicubic LRHS, HRLS, both filters of a plain render of as many samples, fused, reference side by side."""
    pair = PAIRS[model.scale][0]
    bicubic, atrous, svgf = (rival(method, model.scale, pair, 0) for method in ("bicubic", "atrous", "svgf"))
    hrls = Job("render", hrls=render(pair[1]))
    images = [job.image(view, program)[0] for job in (bicubic, hrls, atrous, svgf, base(model))]
    images.append(view.reference())
    return worst_crops([srgb(image) for image in images], -2)


def write_worst(model, views, store, folder, count=3):
    """Writes a picture of each of the `count` views with the least lead over the SVGF-like filter; returns the views.

    The least lead comes first. All views must have been measured.
    """
    order = sorted(views, key=lambda view: first_lead(model, view, store, ("svgf",))[0])
    for i, view in enumerate(order[:count]):
        pyplot.imsave(folder / f"quality-worst-{i + 1}.png", crops(model, view, store.program))
    return order[:count]

"""Filters HRLS, guided by the smooth LRHS; the levels are an input of the network and candidates of its output."""

import pathlib

import torch
import torch.nn.functional as F

import compiled
from compiled import pointer

BINOMIAL = (0.25, 0.5, 0.25)


def slow_level(x, guides, step):
    """Does the same as level() in any precision and on any device, by operations whose gradients PyTorch knows."""
    height, width = x.shape[-2:]
    padded_x, padded_guides = (F.pad(image, [step] * 4, mode="replicate") for image in (x, guides))
    total = certainty = weights = 0
    for tap in range(9):
        dy, dx = tap // 3 * step, tap % 3 * step
        near = lambda image: image[..., dy : dy + height, dx : dx + width]
        distance = ((near(padded_guides) - guides) ** 2).sum(1, keepdim=True)
        weight = BINOMIAL[tap // 3] * BINOMIAL[tap % 3] * torch.exp(-distance)
        counted = weight * near(padded_x[:, 3:])
        total, certainty = total + counted * near(padded_x[:, :3]), certainty + counted
        weights = weights + weight
    return torch.cat([total / certainty, certainty / weights], dim=1)


def library():
    return compiled.library(pathlib.Path(__file__).with_suffix(".cpp"))


class Level(torch.autograd.Function):
    @staticmethod
    def forward(context, x, guides, step):
        x, guides = x.contiguous(), guides.contiguous()
        out = torch.empty_like(x)
        n, _, height, width = x.shape
        sizes = (n, guides.shape[1], height, width, step)
        library().level_forward(pointer(x), pointer(guides), *sizes, pointer(out))
        context.save_for_backward(x, guides, out)
        context.sizes = sizes
        return out

    @staticmethod
    def backward(context, grad):
        saved, grad = context.saved_tensors, grad.contiguous()
        grads = [torch.zeros_like(tensor) for tensor in saved[:2]]
        library().level_backward(*map(pointer, saved), pointer(grad), *context.sizes, *map(pointer, grads))
        return *grads, None


def level(x, guides, step):
    """Filters x [N, 4, H, W] by guides [N, G, H, W]; returns [N, 4, H, W].

    A pixel becomes the mean of its 3x3 neighbours at distances of `step`, edges replicated. The weights are binomial,
    times exp(-|difference of guides|^2); Dammertz et al. 2010. The last channel is the certainty, which
    weights the mean of the other channels and is averaged itself; Knutsson and Westin 1993.
    """
    return Level.apply(x, guides, step) if compiled.takes(x) else slow_level(x, guides, step)


def joint_filter(x, guides, levels, widths=None):
    """Returns a list of levels [N, 4, H, W] at steps of 1, 2, 4 ..., each computed from the one before it.

    `widths` [levels, N or 1, G] multiply the guides.
    """
    result = []
    for i in range(levels):
        scaled = guides if widths is None else guides * widths[i, :, :, None, None]
        x = level(x, scaled, 2**i)
        result.append(x)
    return result

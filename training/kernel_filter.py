"""Filters images by kernels that a network predicts for each pixel."""

import pathlib

import torch
import torch.nn.functional as F

import compiled
from compiled import pointer


def taps(x, side):
    """Returns x as each tap of a kernel sees it, row by row; edges are replicated."""
    height, width = x.shape[-2:]
    padded = F.pad(x, [side // 2] * 4, mode="replicate")
    return [padded[..., i // side :, i % side :][..., :height, :width] for i in range(side * side)]


def slow_kernel_filter(x, logits):
    """Does the same as kernel_filter() in any precision and on any device, by PyTorch's own operations."""
    weights = torch.softmax(logits, dim=1)
    return (weights[:, :, None] * torch.stack(taps(x, int(logits.shape[1] ** 0.5)), dim=1)).sum(1)


def slow_squared_distances(x, side):
    """Does the same as squared_distances() in any precision and on any device."""
    return ((torch.stack(taps(x, side), dim=1) - x[:, None]) ** 2).sum(2)


class KernelFilter(torch.autograd.Function):
    """Has no gradient by the filtered image, which is a render."""

    @staticmethod
    def forward(context, x, logits):
        x, logits = x.contiguous(), logits.contiguous()
        out = torch.empty_like(x)
        n, channels, height, width = x.shape
        context.sizes = (n, channels, height, width, int(logits.shape[1] ** 0.5))
        library().kernel_forward(pointer(x), pointer(logits), *context.sizes, pointer(out))
        context.save_for_backward(x, logits, out)
        return out

    @staticmethod
    def backward(context, grad):
        x, logits, out = context.saved_tensors
        grad, result = grad.contiguous(), torch.empty_like(logits)
        tensors = (pointer(tensor) for tensor in (x, logits, out, grad))
        library().kernel_backward(*tensors, *context.sizes, pointer(result))
        return None, result


def library():
    return compiled.library(pathlib.Path(__file__).with_suffix(".cpp"))


def kernel_filter(x, logits):
    """Filters x [N, C, H, W] by logits [N, side^2, H, W]; returns [N, C, H, W].

    A pixel becomes the mean of the side x side pixels around it, edges replicated, weighted by the softmax of its
    logits; Bako et al. 2017.
    """
    return KernelFilter.apply(x, logits) if compiled.takes(x) else slow_kernel_filter(x, logits)


@torch.no_grad()
def squared_distances(x, side):
    """Returns the squared distance [N, side^2, H, W] of each pixel of x [N, C, H, W] and of those around it.

    They go row by row; edges are replicated. x is a render, so there is no gradient.
    """
    if not compiled.takes(x):
        return slow_squared_distances(x, side)
    x = x.contiguous()
    n, channels, height, width = x.shape
    out = x.new_empty(n, side * side, height, width)
    library().squared_distances(pointer(x), n, channels, height, width, side, pointer(out))
    return out

"""An a-trous filter of HRLS that the smooth LRHS guides, as an input of the network and a part of its output."""

import ctypes
import functools
import pathlib
import subprocess
import tempfile

import torch
import torch.nn.functional as F

BINOMIAL = (0.25, 0.5, 0.25)


def slow(x, guides, levels):
    """x [N, 4, H, W], guides [N, G, H, W] -> [levels, N, 4, H, W], each made of the one before it.

    The mean of a pixel's 3x3 neighbours at steps of 1, 2, 4 ..., edges replicated, weighted by a binomial kernel and by
    exp(-|difference of guides|^2); Dammertz et al. 2010. The last channel, the mean of which is kept, says how much
    each pixel counts in the mean of the others; Knutsson and Westin 1993.
    """
    height, width = x.shape[-2:]
    result = []
    for level in range(levels):
        step = 2**level
        padded_x, padded_guides = (F.pad(image, [step] * 4, mode="replicate") for image in (x, guides))
        total = certainty = weights = 0
        for i, dy in enumerate((0, step, 2 * step)):
            for j, dx in enumerate((0, step, 2 * step)):
                near = lambda image: image[..., dy : dy + height, dx : dx + width]
                distance = ((near(padded_guides) - guides) ** 2).sum(1, keepdim=True)
                weight = BINOMIAL[i] * BINOMIAL[j] * torch.exp(-distance)
                counted = weight * near(padded_x[:, 3:])
                total, certainty = total + counted * near(padded_x[:, :3]), certainty + counted
                weights = weights + weight
        x = torch.cat([total / certainty, certainty / weights], dim=1)
        result.append(x)
    return torch.stack(result)


@functools.cache
def library():
    source = pathlib.Path(__file__).with_suffix(".cpp")
    with tempfile.TemporaryDirectory() as folder:
        compiled, built = (pathlib.Path(folder) / f"joint_filter.{ending}" for ending in ("o", "so"))
        options = ["-O3", "-march=native", "-ffast-math", "-fPIC"]
        subprocess.run(["g++", *options, "-c", source, "-o", compiled], check=True)
        # Linked with -ffast-math, it would flush subnormals for the whole process.
        subprocess.run(["g++", "-shared", compiled, "-o", built], check=True)
        return ctypes.CDLL(str(built))


def joint_filter(x, guides, levels):
    """As slow(), many times faster for single precision; it has no gradient."""
    if x.dtype == torch.float64:
        return slow(x, guides, levels)
    x, guides = x.contiguous(), guides.contiguous()
    n, _, height, width = x.shape
    result = torch.empty(levels, *x.shape)
    pointer = lambda tensor: ctypes.c_void_p(tensor.data_ptr())
    library().joint_filter(pointer(x), pointer(guides), n, guides.shape[1], height, width, levels, pointer(result))
    return result

"""Makes a pyramid network that starts as another one: a wider one, or one of another scale.

The wider one computes the same image to the last bit or so. The weights that read its additional features start at
zero, after Chen et al., Net2Net: Accelerating Learning via Knowledge Transfer, 2016.
"""

import re

import torch

import pyramid


def input_widths(key, config):
    """Returns the widths of the features that a pyramid's convolution reads side by side, or None if these are one."""
    widths = [config.upscaled_features, *map(int, config.widths)]
    if match := re.fullmatch(r"join\.(\d+)\.weight", key):
        level = int(match[1])
        return [widths[level], widths[level] if level else pyramid.GUIDE_CHANNELS]
    return [widths[config.halvings], 6] if key == "lrhs.weight" else None


def is_narrower(small, large):
    """Says whether two pyramids differ in the number of their features alone, of which the second has more."""
    widths = lambda config: [config.upscaled_features, *map(int, config.widths)]
    same = all(
        mine == larger
        for (name, mine), larger in zip(vars(small).items(), vars(large).values())
        if name not in ("widths", "upscaled_features")
    )
    fewer = all(a <= b for a, b in zip(widths(small), widths(large)))
    return small.network == "pyramid" and same and len(small.widths) == len(large.widths) and small != large and fewer


def widened(tensors, small, large, own):
    """Returns the state of a wider pyramid that computes the same as `tensors`; `own` is its state before."""
    return {
        key: placed(own[key], value, input_widths(key, small), input_widths(key, large))
        for key, value in tensors.items()
    }


def differs_in_lrhs_alone(before, after):
    """Says whether two pyramids have other scales, and all that does not concern LRHS is the same."""
    about_lrhs = ("scale", "lrhs_sampling", "lrhs_certainty")
    same = all(mine == vars(after)[name] for name, mine in vars(before).items() if name not in about_lrhs)
    return before.network == "pyramid" and before.scale != after.scale and same


def offsets(widths):
    return [sum(widths[:i]) for i in range(len(widths))]


def overlaid(own, value):
    """Returns `own` with its corner replaced by `value`; the same outputs' weights for other inputs become zero."""
    corner = tuple(slice(0, size) for size in value.shape)
    result = own.clone()
    result[corner[0]] = 0
    result[corner] = value
    return result


def placed(own, value, widths, large_widths):
    """Returns overlaid(own, value), where inputs of `widths` side by side go to the first of `large_widths` each.

    None stands for inputs that are not divided.
    """
    if widths is None:
        return overlaid(own, value)
    result, rows = own.clone(), slice(0, value.shape[0])
    result[rows] = 0
    for width, source, sink in zip(widths, offsets(widths), offsets(large_widths)):
        result[rows, sink : sink + width] = value[:, source : source + width]
    return result


def rejoined(tensors, before, after, own):
    """Returns the state of a pyramid network from `tensors`, the state of one whose LRHS joins another level.

    `before` and `after` are their configs, which differ in what concerns LRHS, and `own` is the state of the new
    network. The layer that LRHS leaves, if any, goes on without it, and the one that it joins starts without it.
    """
    same = {key: value for key, value in tensors.items() if key in own and not key.startswith("lrhs.")}
    if before.reads_lrhs:
        left = f"level.{before.halvings}"
        same[f"{left}.weight"] = tensors["lrhs.weight"][:, : own[f"{left}.weight"].shape[1]]
        same[f"{left}.bias"] = tensors.get("lrhs.centered_bias", tensors["lrhs.bias"])
    if after.reads_lrhs:
        joined = f"level.{after.halvings}"
        same |= {key: tensors[f"{joined}.bias"] for key in ("lrhs.bias", "lrhs.centered_bias") if key in own}
        same["lrhs.weight"] = overlaid(own["lrhs.weight"], tensors[f"{joined}.weight"])
    return own | same

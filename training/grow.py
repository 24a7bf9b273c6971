"""Makes a network that starts as another one: a larger one with room to learn more, or a pyramid of another scale.

A larger network computes the same image to the last bit or so.

The larger network's additional parts (features, dense layers, blocks, groups) keep their random weights. The weights
that read them start at zero, after Chen et al., Net2Net: Accelerating Learning via Knowledge Transfer, 2016.
"""

import re

import torch

import pyramid


def input_widths(key, config):
    """Returns the widths of the features that a trunk tensor reads, in order, or None if it reads anything else."""
    c, r = config.features, config.growth
    if key == "fuse.weight":
        return [c, c]
    if key == "up.0.weight":
        return [c]
    if match := re.fullmatch(r"groups\.\d+\.blocks\.\d+\.(?:dense\.(\d+)|merge)\.weight", key):
        return [c] + [r] * (int(match[1]) if match[1] else config.dense_layers)
    return None


def is_smaller(small, large):
    """Says whether a network of `small` can become one of `large`: the Configs differ in the trunk's size at most."""
    sizes = ("features", "growth", "dense_layers", "blocks", "groups")
    return all(
        mine <= larger if name in sizes else mine == larger
        for (name, mine), larger in zip(vars(small).items(), vars(large).values())
    )


def pyramid_input_widths(key, config):
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
        key: placed(own[key], value, pyramid_input_widths(key, small), pyramid_input_widths(key, large))
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
    """Returns `own` with its corner replaced by `value`; the same outputs' weights for other inputs become zero.

    A 1x1 convolution takes the sum of a 3x3's taps, which gives the same for an even image; a 3x3 takes a 1x1 as its
    middle tap.
    """
    kernels = tuple(own.shape[2:]), tuple(value.shape[2:])
    if kernels == ((1, 1), (3, 3)):
        value = value.sum(dim=(2, 3), keepdim=True)
    if kernels == ((3, 3), (1, 1)):
        value = torch.nn.functional.pad(value, (1, 1, 1, 1))
    corner = tuple(slice(0, min(sizes)) for sizes in zip(own.shape, value.shape))
    result = own.clone()
    result[corner[0]] = 0
    result[corner] = value[corner]
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


def grow(tensors, small, large, own):
    """Returns the state of a `large` network that computes the same as `tensors`, the state of a `small` one.

    `own` is the state of the large network before.
    """
    extra = large.groups - small.groups
    state = {key: value.clone() for key, value in own.items()}
    for key, value in state.items():
        # A block that merges nothing hands its input on.
        if ".merge." in key:
            value.zero_()
    for key, value in tensors.items():
        name = re.sub(r"^groups\.(\d+)", lambda match: f"groups.{int(match[1]) + extra}", key)
        value = value.clone()
        if key.startswith("fuse."):
            # The added groups come first. Their blocks hand the input on, so each group doubles it.
            value *= 0.5**extra
        state[name] = placed(state[name], value, input_widths(key, small), input_widths(key, large))
    return state


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

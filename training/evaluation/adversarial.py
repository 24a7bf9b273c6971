"""Makes models whose weights are hard on 16 bits: He-scaled, with activations beyond the largest half, 65504."""

import math

import torch

import export
import model as networks
import stock
from evaluation import agreement
from evaluation.jobs import Model

LARGEST = 1e5  # target for the groups' activations on the pair as rendered
MOST_OUTPUT = 1.0  # target for the last layer's output, likewise

CONFIGS = {
    # Its trunk works at a quarter of the size, and its head reads HRLS again.
    "He, at a quarter of the size": stock.config(
        "x4-full", ["features=24", "growth=16", "dense_layers=3", "blocks=2", "groups=1", "head_features=16"]
    ),
    # The paper's kind convolves HRLS at full size, doubles in stages, is scene linear and adds no base to its output.
    "He, the paper's kind": networks.Config(
        4, 16, 16, 3, 2, 2, transfer="linear", clip=100.0, base="none", exposure_key=0.18
    ),
}


def scale(module, log2):
    for conv in module.modules():
        if isinstance(conv, torch.nn.Conv2d):
            conv.weight.data.mul_(2.0**log2)


def network(config, files):
    """Makes a network in which powers of two bring the groups' activations to LARGEST, and back after the groups."""
    torch.manual_seed(1)
    result = networks.create(config).eval()
    for conv in result.modules():
        if isinstance(conv, torch.nn.Conv2d):
            torch.nn.init.kaiming_normal_(conv.weight)
            torch.nn.init.zeros_(conv.bias)
    watched = lambda: agreement.predict_watched(result, *files)[1]
    up = math.ceil(math.log2(LARGEST / max(value for name, value in watched().items() if name.startswith("groups"))))
    for first in (result.lrhs, result.hrls):
        scale(first, up)
    # Two layers share the way back: weights that are too small for 16 bits would be another matter.
    scale(result.up[0], -(up // 2))
    scale(result.rec, up // 2 - up)
    scale(result.rec, round(math.log2(MOST_OUTPUT / watched()["rec"])))
    return result.float()


def write_all(folder, files):
    """Writes the models to `folder` and returns them; their activations are scaled on `files`, LRHS and HRLS."""
    models = []
    for name, config in CONFIGS.items():
        path = folder / f"{name}.safetensors"
        state = network(config, files).state_dict()
        export.write(path, name, config, state, {"untrained": True})
        models.append(Model.load(path))
    return models

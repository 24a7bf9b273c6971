"""Checks that the program and PyTorch fuse alike, and measure alike."""

import json
import math
import pathlib
import subprocess
import tempfile

import numpy
import torch

import pack
import loss
import model as networks
from evaluation.images import Exr, read
from evaluation.jobs import fuse
from evaluation.test_set import PAIRS, lrhs, render

SIZE = 128  # side of the part that is fused, in pixels of HRLS
# The error that rounding to fp32 makes is measured on PyTorch, against float64. The program sums in another order and
# with another device's logarithm and exponential, so it may be off by ROUNDING times as much.
ROUNDING = 16
PSNR_DB, RELMSE = 1e-3, 1e-4  # largest differences of the metrics; RelMSE's is relative


def layers_of(path, names):
    """Returns {name: [1, 3, H, W]}, in single precision and finite, as the program reads the layers."""
    read = [name for name in names if name != "variance"]
    with numpy.errstate(over="ignore", invalid="ignore"):  # very bright passes overflow when added up
        layers = dict(zip(read, torch.from_numpy(pack.read_layers(path, read))[None].split(3, dim=1)))
    if "variance" in names:
        single = torch.finfo(torch.float32).max
        layers["variance"] = networks.variance(layers["color"].double()).clamp(max=single).float()
    most = networks.HALF_MAX
    return {name: torch.nan_to_num(layers[name], nan=0.0, posinf=most, neginf=-most) for name in names}


def exposure(network, lrhs_path):
    """Returns the factor of radiance, rounded to a float as in the program."""
    return float(numpy.float32(networks.exposure(layers_of(lrhs_path, ("color",))["color"].double(), network.config)))


@torch.no_grad()
def predict(network, lrhs_path, hrls_path, dtype):
    """Computes the fused image, scene linear [3, H, W], in `dtype` from the stored weights and the files' values.

    LRHS is an ordinary small render.
    """
    config = network.config
    factor = exposure(network, lrhs_path)
    low = layers_of(lrhs_path, ("color",))["color"].to(dtype)
    hrls, power = None, {"albedo": 0, "normal": 0, "variance": 2}
    if config.reads_hrls:
        layers = {name: layer.to(dtype) for name, layer in layers_of(hrls_path, config.hrls_layers).items()}
        hrls = torch.cat([layer * factor ** power.get(name, 1) for name, layer in layers.items()], dim=1)
    fused = networks.predict(network.to(dtype), low * factor, hrls, torch.tensor(True), factor)[1]
    return (fused[0].double() / factor).clamp(max=networks.HALF_MAX)


def predict_watched(network, lrhs_path, hrls_path):
    """Returns predict() in float64, and the largest magnitude of each layer's sums by the layer's name."""
    seen = {}
    parts = (torch.nn.Conv2d, networks.Block, networks.Group)
    hooks = [
        part.register_forward_hook(lambda _, __, y, name=name: seen.update({name: float(y.abs().max())}))
        for name, part in network.named_modules()
        if isinstance(part, parts)
    ]
    image = predict(network, lrhs_path, hrls_path, torch.float64)
    for hook in hooks:
        hook.remove()
    return image, seen


def colour(path):
    """Reads an image as float64 [3, H, W]."""
    return torch.from_numpy(read(path)).double().permute(2, 0, 1)


def write_crop(path, size, output):
    exr = Exr.read(path)
    exr.pixels = exr.pixels[:size, :size]
    exr.write(output)


def compare(program, image, reference):
    done = subprocess.run([str(program), "compare", "--json", image, reference], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout)


@torch.no_grad()
def check(model, view, program):
    """Returns {comparison: (value, limit)}; the program agrees if no value is beyond its limit."""
    network, pair = networks.load(model.path), PAIRS[model.scale][0]
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        low, high, reference, fused = (folder / f"{name}.exr" for name in ("low", "high", "reference", "fused"))
        if model.reads_lrhs:
            write_crop(view.folder / lrhs(model.scale, pair[0]), SIZE // model.scale, low)
        write_crop(view.folder / render(pair[1]), SIZE, high)
        write_crop(view.folder / "reference-a.exr", SIZE, reference)
        low = low if model.reads_lrhs else high  # HRLS stands for LRHS
        fuse(program, model, low, high, fused)
        own = colour(fused)
        exact, single = (predict(network, low, high, dtype) for dtype in (torch.float64, torch.float32))
        said = compare(program, fused, reference)
        truth = colour(reference)
    encoded = [networks.transfer(image, "log") for image in (own, single, exact)]
    off = [float((image - encoded[2]).abs().max()) for image in encoded]
    psnr, relmse = loss.psnr(own, truth), loss.relmse(own, truth)
    return {
        "largest error, encoded": (off[0], ROUNDING * off[1]),
        "PSNR, program - PyTorch, dB": (abs(psnr - loss.psnr(exact, truth)), PSNR_DB),
        "RelMSE, program / PyTorch - 1": (abs(relmse / loss.relmse(exact, truth) - 1), RELMSE),
        "PSNR as compare says, dB": (abs(psnr - said["psnr_db"]), PSNR_DB),
        "RelMSE as compare says, relatively": (abs(relmse / said["relmse_bcr"] - 1), RELMSE),
    }


def agrees(results):
    return all(math.isfinite(value) and value <= limit for value, limit in results.values())

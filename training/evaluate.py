#!/usr/bin/env python3
"""PSNR (sRGB) and RelMSE (0.5, 0.01) of a model file on one pair, next to bicubic LRHS and HRLS itself."""

import argparse

import torch

import dataset
import loss
import model
import safetensors


def load(path):
    tensors, metadata = safetensors.load(path)
    numbers = (int(metadata[key]) for key in ("scale", "features", "growth", "dense_layers", "blocks", "groups"))
    config = model.Config(
        *numbers,
        hrls_layers=tuple(metadata["hrls_layers"].split(",")),
        long_skip=metadata["long_skip"],
        merge_relu=metadata["merge_relu"] == "true",
        transfer=metadata["transfer"],
        clip=float(metadata["clip"]),
        base=metadata["base"],
    )
    network = model.Network(config)
    network.load_state_dict({key: torch.from_numpy(value.astype("float32")) for key, value in tensors.items()})
    return network.eval()


def bicubic(x, scale, a=-0.5):
    """Keys' kernel; LR sample i sits at HR coordinate s*i; edges replicated."""
    for axis in (-2, -1):
        size = x.shape[axis]
        u = torch.arange(size * scale) / scale
        total = 0
        for tap in range(-1, 3):
            d = (u - u.floor() - tap).abs()
            near, far = ((a + 2) * d - (a + 3)) * d * d + 1, ((a * d - 5 * a) * d + 8 * a) * d - 4 * a
            weight = torch.where(d <= 1, near, far)
            index = (u.floor().long() + tap).clamp(0, size - 1)
            total = total + x.index_select(axis, index) * (weight[:, None] if axis == -2 else weight)
        x = total
    return x


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("model", "lrhs", "hrls", "reference"):
        parser.add_argument("--" + name, required=True)
    args = parser.parse_args()
    torch.set_grad_enabled(False)
    network = load(args.model)
    lrhs = dataset.read(args.lrhs, ("color",))[None]
    layers = dataset.read(args.hrls, ("color", "albedo", "normal", "diffuse", "specular"))
    hrls = dataset.with_variance(layers)[None]
    reference = dataset.read(args.reference, ("color",))[None]
    images = {
        "fused": model.predict(network, lrhs, hrls)[1],
        "bicubic LRHS": bicubic(lrhs, network.config.scale),
        "HRLS": hrls[:, :3],
    }
    for name, image in images.items():
        print(f"{name:13} {loss.psnr(image, reference):6.2f} dB  RelMSE {loss.relmse(image, reference):.4f}")


if __name__ == "__main__":
    main()

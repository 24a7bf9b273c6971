"""Packs a view's renders into one file of half floats, half the size of EXR, which is read in a tenth of the time.

A view is a safetensors file. Each tensor is a render [C, H, W] with the name of its file: "0001", "reference-a",
"lowres-x4-0016", "guides-0004". `__metadata__.view` is its view.json. A render with layers has CHANNELS, the renders
named guides have only GUIDES.
"""

import json

import numpy
import OpenImageIO as oiio

import safetensors

HALF_MAX = 65504.0
CHANNELS = ("color", "albedo", "normal", "diffuse", "specular", "emission", "depth")  # three channels each, depth one
GUIDES = ("albedo", "normal", "depth")


def read_layers(path, layers):
    """Reads layers of a Blender multilayer file with one view layer, as float32 [C, H, W]."""
    image = oiio.ImageBuf(str(path))
    pixels = image.get_pixels(oiio.FLOAT)
    if image.has_error:
        raise OSError(f"{path}: {image.geterror()}")
    names = [name.split(".", 1)[-1] for name in image.spec().channelnames]

    def take(name, channels="RGB"):
        return numpy.stack([pixels[..., names.index(f"{name}.{c}")] for c in channels])

    def lit(kind):
        return take(kind + "Col") * (take(kind + "Dir") + take(kind + "Ind"))

    read = {
        "color": lambda: take("Combined"),
        "albedo": lambda: take("Denoising Albedo"),
        "normal": lambda: take("Denoising Normal", "XYZ"),
        "depth": lambda: take("Denoising Depth", "Z"),
        "diffuse": lambda: lit("Diff"),
        "specular": lambda: lit("Gloss"),
        "emission": lambda: take("Emit") + take("Env"),
    }
    return numpy.ascontiguousarray(numpy.concatenate([read[layer]() for layer in layers]))


def to_half(x):
    return numpy.nan_to_num(x, posinf=HALF_MAX).clip(-HALF_MAX, HALF_MAX).astype(numpy.float16)


def pack(folder, path):
    """Writes the view in `folder` to `path`, whole or not at all."""
    record = json.loads((folder / "view.json").read_text())
    tensors = {
        name.removesuffix(".exr"): to_half(
            read_layers(folder / name, GUIDES if name.startswith("guides") else CHANNELS)
        )
        for name in record["files"]
    }
    partial = path.with_suffix(".part")
    safetensors.save(partial, tensors, {"view": json.dumps(record)})
    partial.rename(path)


def unpack(path):
    """Returns ({name: float16 [C, H, W]}, the view's record)."""
    tensors, metadata = safetensors.load(path)
    return tensors, json.loads(metadata["view"])

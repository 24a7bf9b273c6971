"""A view's renders in one file of half floats, as training reads them: no EXR, a tenth of the time, half of the size.

A view is a safetensors file. Each tensor is a render, [C, H, W], named as its file was: "0001", "reference-a",
"lowres-x4-0016", "guides-0004". `__metadata__.view` is its view.json. CHANNELS are those of a render with layers;
guides have GUIDES alone.
"""

import json

import numpy
import OpenImageIO as oiio

import safetensors

HALF_MAX = 65504.0
CHANNELS = ("color", "albedo", "normal", "diffuse", "specular", "emission", "depth")  # 3 each, depth 1
GUIDES = ("albedo", "normal", "depth")


def read_layers(path, layers):
    """[C, H, W], float32, of a Blender multilayer file with one view layer."""
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
        name.removesuffix(".exr"): to_half(read_layers(folder / name, GUIDES if name.startswith("guides") else CHANNELS))
        for name in record["files"]
    }
    partial = path.with_suffix(".part")
    safetensors.save(partial, tensors, {"view": json.dumps(record)})
    partial.rename(path)


def unpack(path):
    """({name: [C, H, W], float16}, the view's record)."""
    tensors, metadata = safetensors.load(path)
    return tensors, json.loads(metadata["view"])

"""Reads and writes EXR files as arrays, and measures how far an image is from its reference."""

import dataclasses

import numpy
import OpenImageIO as oiio
import torch

import loss
import pack

CLIP = 100.0  # section 3.2 of the paper takes anything brighter for a firefly


def layers(path, names):
    """Reads the layers of these names as pack.read_layers() does, each float32 [H, W, 3]."""
    planes = pack.read_layers(path, names)
    return [numpy.ascontiguousarray(layer.transpose(1, 2, 0)) for layer in numpy.split(planes, len(names))]


def clipped(image):
    return torch.from_numpy(numpy.ascontiguousarray(image)).double().clamp(0, CLIP)


def psnr(image, reference):
    """Computes the PSNR in sRGB (Equation 3), in decibels."""
    return loss.psnr(clipped(image), clipped(reference))


def relmse(image, reference):
    """Computes RelMSE with (0.5, 0.01) on scene linear values."""
    return loss.relmse(clipped(image), clipped(reference))


@dataclasses.dataclass
class Exr:
    """Holds all channels of a file; `pixels` is float32 [H, W, C]."""

    channels: list
    pixels: numpy.ndarray

    @classmethod
    def read(cls, path):
        image = oiio.ImageBuf(str(path))
        pixels = image.get_pixels(oiio.FLOAT)
        if image.has_error:
            raise OSError(f"{path}: {image.geterror()}")
        return cls(list(image.spec().channelnames), pixels)

    def write(self, path):
        height, width, count = self.pixels.shape
        spec = oiio.ImageSpec(width, height, count, oiio.FLOAT)
        spec.channelnames = self.channels
        spec["compression"] = "zips"
        out = oiio.ImageBuf(spec)
        out.set_pixels(oiio.ROI(), self.pixels)
        if not out.write(str(path)):
            raise OSError(f"{path}: {out.geterror()}")

    def indices(self, wanted):
        """Returns the indices of the channels for which wanted(layer) is true; `layer` lacks the view layer's name."""
        return [i for i, name in enumerate(self.channels) if wanted(name.rsplit(".", 1)[0].split(".", 1)[-1])]


def read(path):
    """Reads the colour [H, W, 3] of a render or of the program's output."""
    exr = Exr.read(path)
    prefix = "" if "R" in exr.channels else exr.channels[exr.indices(lambda layer: layer == "Combined")[0]][:-1]
    return exr.pixels[..., [exr.channels.index(prefix + c) for c in "RGB"]]

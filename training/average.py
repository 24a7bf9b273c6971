#!/usr/bin/env python3
"""Averages renders of one view, weighted by their sample counts, into one EXR: average.py OUT.exr IN.exr..."""

import sys

import OpenImageIO as oiio


def samples(image):
    return int(image.spec().getattribute("cycles.ViewLayer.samples"))


def main():
    out, *paths = sys.argv[1:]
    images = [oiio.ImageBuf(path) for path in paths]
    total = sum(samples(image) for image in images)
    mean = sum(image.get_pixels(oiio.FLOAT) * (samples(image) / total) for image in images)
    spec = oiio.ImageSpec(images[0].spec())
    spec.attribute("cycles.ViewLayer.samples", str(total))
    result = oiio.ImageBuf(spec)
    result.set_pixels(spec.roi, mean)
    result.set_write_format("half")
    if not result.write(out):
        raise OSError(f"{out}: {result.geterror()}")


main()

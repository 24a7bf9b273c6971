#!/usr/bin/python3
"""Makes packed views a sixth of their size, to be carried to a machine that trains, and unpacks them there.

compact.py pack FOLDER OUT makes FOLDER/view-X.safetensors OUT/view-X.xz; compact.py unpack IN FOLDER does the reverse.

Training reads the light of each render, and albedo and normal of those that HRLS can be. They lose bits where noise
hides it: light keeps 4 bits of its mantissa (5 in references and small renders), rounded up or down by chance so that
means stay, albedo and normal become multiples of 1/127, and the rest is gone. The renders of a view are then 49 dB of
PSNR or more from what they were.
"""

import argparse
import concurrent.futures
import functools
import json
import lzma
import pathlib
import tempfile

import numpy

import safetensors

LIGHT, GUIDE_CHANNELS, CHANNELS = [0, 1, 2, 9, 10, 11, 12, 13, 14], slice(3, 9), 15
HALF_BITS, NOISY_BITS, CLEAN_BITS = 10, 4, 5  # bits of a mantissa
STEPS = 127  # of an albedo or normal from 0 to 1
LARGEST = numpy.uint32(numpy.float16(65504).view(numpy.uint16))


def rounded(x, bits, rng):
    """Returns halves as integers with so many bits of mantissa, rounded up by chance."""
    whole = numpy.nan_to_num(x).view(numpy.uint16).astype(numpy.uint32)
    sign, size, dropped = whole & 0x8000, whole & 0x7FFF, HALF_BITS - bits
    up = rng.integers(0, 1 << dropped, size.shape, dtype=numpy.uint32)
    size = numpy.where(size == 0, 0, numpy.minimum(size + up, LARGEST) >> dropped << dropped)
    return (sign | size).astype(numpy.uint16)


def is_clean(name):
    return name.startswith(("reference", "lowres"))


def has_light(name):
    return not name.startswith("guides")


def shrunk(name, x, rng):
    """Returns a render of dataset.View as uint8 [planes, H, W]: upper bytes of light, lower ones, and guides."""
    planes = []
    if has_light(name):
        light = rounded(x[LIGHT], CLEAN_BITS if is_clean(name) else NOISY_BITS, rng)
        planes += [light >> 8, light & 255]
    if not is_clean(name):
        guides = numpy.nan_to_num((x[GUIDE_CHANNELS] if has_light(name) else x[:6]).astype(numpy.float32)) * STEPS
        planes.append(guides.clip(-STEPS, STEPS).round() + STEPS)
    return numpy.concatenate(planes).astype(numpy.uint8)


def restored(name, planes):
    """Inverts shrunk(); what it dropped is 0."""
    guides = (planes[-6:].astype(numpy.float32) - STEPS) / STEPS
    if not has_light(name):
        return guides.astype(numpy.float16)
    x = numpy.zeros((CHANNELS, *planes.shape[1:]), numpy.float16)
    high, low = planes[: len(LIGHT)], planes[len(LIGHT) : 2 * len(LIGHT)]
    x[LIGHT] = (high.astype(numpy.uint16) << 8 | low).view(numpy.float16)
    if not is_clean(name):
        x[GUIDE_CHANNELS] = guides
    return x


def pack(path, out):
    file, rng = safetensors.Lazy(path), numpy.random.default_rng(1)
    record = json.loads(file.metadata["view"])
    names = [name.removesuffix(".exr") for name in record["files"]]
    renders = {name: shrunk(name, file.read(name), rng) for name in names}
    write_whole(out / f"{path.stem}.xz", lambda partial: write_compressed(partial, renders, file.metadata))


def write_compressed(path, tensors, metadata):
    with tempfile.NamedTemporaryFile() as plain:
        safetensors.save(plain.name, tensors, metadata)
        path.write_bytes(lzma.compress(pathlib.Path(plain.name).read_bytes()))


def unpack(path, out):
    with tempfile.NamedTemporaryFile() as plain:
        pathlib.Path(plain.name).write_bytes(lzma.decompress(path.read_bytes()))
        renders, metadata = safetensors.load(plain.name)
        tensors = {name: restored(name, planes) for name, planes in renders.items()}
    write_whole(out / f"{path.stem}.safetensors", lambda partial: safetensors.save(partial, tensors, metadata))


def write_whole(path, write):
    partial = path.with_suffix(".part")
    write(partial)
    partial.rename(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("pack", "unpack"))
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    work, pattern = (pack, "view-*.safetensors") if args.what == "pack" else (unpack, "view-*.xz")
    with concurrent.futures.ProcessPoolExecutor() as pool:
        list(pool.map(functools.partial(work, out=args.out), sorted(args.folder.glob(pattern))))


if __name__ == "__main__":
    main()

#!/usr/bin/python3
"""Counts how often `raymeld fuse` is right about pairs: where LRHS samples lie, how bright it is, unrelated renders.

VIEWS are packed views of ../scenes/pairs.py. Each gives pairs of every scale, samples a pixel and kind of LRHS, and
pairs that do not belong together.
"""

import argparse
import collections
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))
import dataset
from evaluation.images import Exr

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
HRLS = ("0001", "0002", "0004")
COLOR, LAYERED = list("RGB"), [f"{layer}.{c}" for layer in ("albedo", "normal") for c in "RGB"]


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", required=True, type=pathlib.Path, nargs="+", help="files of packed views")
    parser.add_argument("--program", type=pathlib.Path, default=ROOT / "build/release/raymeld")
    return parser.parse_args()


def colors(view, name):
    """Returns the colour of a render as float32 [H, W, 3]."""
    return numpy.ascontiguousarray(view.read(name)[:3].float().numpy().transpose(1, 2, 0))


def honest(view, scale):
    """Yields (sampling, color) of each LRHS of a view."""
    for name in view.small(scale):
        yield "centered", colors(view, name)
    for name in ("0004", "0008", *dataset.REFERENCE):
        yield "nearest", numpy.ascontiguousarray(colors(view, name)[::scale, ::scale])


def strangers(lrhs, other, rng):
    yield "mirrored", lrhs[:, ::-1]
    yield "flipped", lrhs[::-1]
    yield "noise", rng.exponential(lrhs.mean(), lrhs.shape)
    yield "another view", other


class Program:
    def __init__(self, path, folder):
        self.path, self.folder = path, folder

    def write(self, name, color, layers=None):
        pixels = color if layers is None else numpy.concatenate([color, layers], axis=-1)
        names = COLOR if layers is None else COLOR + LAYERED
        Exr(names, numpy.ascontiguousarray(pixels, dtype=numpy.float32)).write(self.folder / name)

    def examined(self):
        """Returns the program's findings about low.exr and high.exr, or {"error": ...} if it refuses them."""
        files = ["--lrhs", self.folder / "low.exr", "--hrls", self.folder / "high.exr"]
        result = subprocess.run([self.path, "fuse", "--dry-run", "--json", *files], capture_output=True, text=True)
        return json.loads(result.stdout) if result.returncode == 0 else {"error": result.stderr}


def count(found, truth, counts):
    counts["pairs"] += 1
    if "error" in found:
        if "show different things" not in found["error"]:
            raise RuntimeError(found["error"])
        counts["refused"] += 1
        return
    right, shown = truth == found["lrhs_sampling"], found["lrhs_sampling_from"] == "pair"
    counts["phase right"] += right
    counts["phase not shown"] += not shown
    counts["phase wrong though shown"] += shown and not right
    counts["another brightness"] += found["lrhs_brightness"] != 1
    counts["doubtful"] += 0 < found["pair_correlation"] < 0.38


def measure(view, other, program, tables):
    rng = numpy.random.default_rng(1)
    for hrls in HRLS:
        render = view.read(hrls).float().numpy()
        color = numpy.ascontiguousarray(render[:3].transpose(1, 2, 0))
        program.write("high.exr", color, render[3:9].transpose(1, 2, 0))
        for scale in (2, 4, 8):
            for truth, lrhs in honest(view, scale):
                program.write("low.exr", lrhs)
                count(program.examined(), truth, tables[truth, f"x{scale}", hrls])
            lrhs = colors(view, view.small(scale)[0])
            for what, stranger in strangers(lrhs, colors(other, other.small(scale)[0]), rng):
                program.write("low.exr", stranger)
                count(program.examined(), "", tables[what, f"x{scale}", hrls])
            for factor in (0.25, 1.3, 4):
                program.write("low.exr", lrhs * factor)
                found, counts = program.examined(), tables[f"times {factor}", f"x{scale}", hrls]
                counts["pairs"] += 1
                counts["factor right"] += abs(found.get("lrhs_brightness", 0) * factor - 1) < 0.1


def main():
    args = parse()
    views = [dataset.View(path) for path in args.views]
    tables = collections.defaultdict(collections.Counter)
    with tempfile.TemporaryDirectory() as folder:
        program = Program(args.program, pathlib.Path(folder))
        for i, view in enumerate(views):
            other = views[(i + len(views) // 2) % len(views)]
            measure(view, other, program, tables)
    for (what, scale, hrls), counts in sorted(tables.items()):
        print(f"{what:12} {scale} {hrls}  " + ", ".join(f"{name} {n}" for name, n in counts.items() if n))
    honest_pairs = [counts for (what, *_), counts in tables.items() if what in ("nearest", "centered")]
    total = sum(honest_pairs, collections.Counter())
    print("honest pairs: " + ", ".join(f"{name} {n}" for name, n in total.items()))


if __name__ == "__main__":
    main()

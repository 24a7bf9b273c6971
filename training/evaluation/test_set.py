"""Reads the test set's files, which scenes/test_set.py renders."""

import functools
import hashlib
import json
import pathlib

import numpy

from evaluation.images import read

# PAIRS and PAPER_PAIRS hold samples a pixel of LRHS and HRLS by scale. Their average, spp_LRHS / s^2 + spp_HRLS, is one
# of AVERAGES. In PAIRS LRHS has one sample for each full-size pixel, and HRLS all others; in PAPER_PAIRS both have more
# (Table 2 of Hou et al. 2021). At a scale of 1 HRLS has all samples.
AVERAGES = (2, 4, 8)
ALONE = {1: tuple((0, spp) for spp in AVERAGES)}
PAIRS = ALONE | {scale: tuple((scale**2, spp - 1) for spp in AVERAGES) for scale in (2, 4, 8)}
PAPER_PAIRS = ALONE | {scale: tuple((scale**2 * n, n) for n in (1, 2, 4)) for scale in (2, 4, 8)}
PLAIN = (1, 2, 4, 8, 16, 32)
ALL_PLAIN = sum(PLAIN)  # samples of the mean of all plain renders, weighted by samples; they share no noise


def render(spp):
    return f"{spp:04}.exr"


def lrhs(scale, spp):
    """Returns the file of an ordinary small render, whose samples lie all over its pixels; "" at a scale of 1."""
    return f"lowres-x{scale}-{spp:04}.exr" if scale > 1 else ""


def decimated(scale, spp):
    """Returns the file with every scale-th pixel of a full-size render."""
    return f"lrhs-x{scale}-{spp:04}.exr"


def guides(spp):
    """Returns the file of albedo and normal of a render of their own."""
    return f"guides-{spp:04}.exr"


HALVES = ("reference-a.exr", "reference-b.exr")


@functools.cache
def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


class View:
    def __init__(self, folder):
        self.folder, self.name = folder, folder.name
        self.record = json.loads((folder / "view.json").read_text())

    @functools.cached_property
    def identity(self):
        """Says which scene this is. Rendered again, its files have other dates and stray last bits."""
        return [self.record["version"], *(digest(self.folder / half) for half in HALVES)]

    @functools.cached_property
    def cost(self):
        """Returns (seconds for each sample a pixel, other seconds) of a full-size render, fitted to the times of all.

        A render of 1 / s^2 of the pixels takes 1 / s^2 of the time. Other load on the machine only makes it slower, so
        the line is fitted to the lower quartile (of relative deviations, by reweighted least squares).
        """
        timed = [file for file in self.record["files"].values() if "seconds" in file]
        files = [file for file in timed if file.get("layers") != "guides"]
        spp = numpy.array([file["spp"] for file in files])
        seconds = numpy.array([file["seconds"] * file.get("scale", 1) ** 2 for file in files])
        line = numpy.polyfit(spp, seconds, 1, w=1 / seconds)
        for _ in range(100):
            late = 1 - numpy.polyval(line, spp) / seconds
            weight = numpy.where(late > 0, 0.25, 0.75) / (numpy.abs(late) + 1e-3)
            line = numpy.polyfit(spp, seconds, 1, w=numpy.sqrt(weight) / seconds)
        return line

    def seconds(self, spp, scale=1):
        """Returns the time of a render at 1 / scale of the size, with that many samples a pixel."""
        return float(numpy.polyval(self.cost, spp)) / scale**2

    def spp(self, file):
        return self.record["files"][file]["spp"]

    def seconds_of(self, file):
        """Returns the time of a render: seconds(), or for guides, which have no light, what was measured."""
        record = self.record["files"][file]
        if record.get("layers") == "guides":
            return record["seconds"]
        return self.seconds(record["spp"], record.get("scale", 1))

    @functools.lru_cache(maxsize=2)
    def reference(self, halves=HALVES):
        return sum(read(self.folder / half) for half in halves) / len(halves)


def load(folder):
    return [View(f) for f in sorted(pathlib.Path(folder).glob("view-*")) if (f / "view.json").exists() and not f.suffix]

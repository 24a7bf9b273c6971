"""The test set's files; scenes/test_set.py renders them."""

import functools
import hashlib
import json
import pathlib

from evaluation.images import read

# LRHS and HRLS samples a pixel by scale: 2, 4 and 8 on average, spp_LRHS / s^2 + spp_HRLS (Table 2 of Hou et al. 2021).
PAIRS = {2: ((4, 1), (8, 2), (16, 4)), 4: ((16, 1), (32, 2), (64, 4)), 8: ((64, 1), (128, 2), (256, 4))}
AVERAGES = (2, 4, 8)
PLAIN = (1, 2, 4, 8, 16, 32, 64)


def render(spp):
    return f"{spp:04}.exr"


def lrhs(scale, spp):
    """Every scale-th pixel of a full-size render."""
    return f"lrhs-x{scale}-{spp:04}.exr"


LOW_RESOLUTION = "lowres-x4-0016.exr"  # rendered at low resolution: samples lie all over their cells
HALVES = ("reference-a.exr", "reference-b.exr")


@functools.cache
def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


class View:
    def __init__(self, folder):
        self.folder, self.name = folder, folder.name
        self.record = json.loads((folder / "view.json").read_text())

    def seconds(self, name):
        """What the render took."""
        return self.record["files"][name]["seconds"]

    @functools.lru_cache(maxsize=2)
    def reference(self, halves=HALVES):
        return sum(read(self.folder / half) for half in halves) / len(halves)


def load(folder):
    return [View(f) for f in sorted(pathlib.Path(folder).glob("view-*")) if (f / "view.json").exists() and not f.suffix]

"""Makes and measures images, and keeps the scores in a file."""

import csv
import dataclasses
import hashlib
import json
import pathlib
import subprocess
import tempfile
import time
from typing import NamedTuple

import model as networks
import safetensors
from evaluation import oidn, test_set
from evaluation.baselines import bicubic
from evaluation.filters import FILTERS, TUNED
from evaluation.changes import CHANGES
from evaluation.images import Exr, layers, psnr, read, relmse


@dataclasses.dataclass(frozen=True)
class Model:
    path: pathlib.Path
    digest: str
    scale: int
    reads_lrhs: bool = True
    reads_hrls: bool = True
    training: str = dataclasses.field(default="{}", compare=False)  # JSON

    @classmethod
    def load(cls, path):
        metadata = safetensors.load(path)[1]
        config, training = networks.Config.parse(metadata), metadata.get("training", "{}")
        return cls(path, test_set.digest(path), config.scale, config.reads_lrhs, config.reads_hrls, training)

    @property
    def name(self):
        return self.path.stem

    def trained(self, key, default=None):
        return json.loads(self.training).get(key, default)


@dataclasses.dataclass(frozen=True)
class Job:
    """Describes one image to be made and measured.

    `method` is half (of the reference), render, renders (the mean of all plain ones), bicubic, oidn (Open Image
    Denoise), fused or one of FILTERS.
    `lrhs`, `hrls` and `guides` are files of a view.
    """

    method: str
    lrhs: str = ""
    hrls: str = ""
    model: Model = None
    change: str = ""
    guides: str = ""

    def halves(self):
        """Returns the halves of the reference to measure against: one that is also an input would share its noise."""
        return tuple(half for half in test_set.HALVES if half != self.lrhs)

    def key(self, view):
        """Returns a hash of everything that the result depends on, except the program."""
        parts = [self.method, self.lrhs, self.hrls, self.guides, self.change, view.identity]
        parts += [str(test_set.PLAIN)] if self.method == "renders" else []
        parts += [self.model.digest] if self.model else []
        parts += [oidn.DIGEST] if self.method == "oidn" else []
        parts += [str(self.parameters())] if self.method in FILTERS else []
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]

    def parameters(self):
        return TUNED[self.method][int(pathlib.Path(self.hrls).stem)]

    def is_small_render(self):
        return self.lrhs.startswith("lowres")

    def changed_files(self, view, folder):
        """Returns (LRHS, HRLS, factor of the result); new files go to `folder`."""
        paths = [view.folder / self.lrhs, view.folder / self.hrls]
        if not self.change:
            return *paths, 1.0
        change, pair = CHANGES[self.change], [Exr.read(path) for path in paths]
        change.apply(*pair, self.model.scale)
        paths = [folder / "lrhs.exr", folder / "hrls.exr"]
        for exr, path in zip(pair, paths):
            exr.write(path)
        return *paths, change.gain

    def fuse(self, view, program):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            lrhs, hrls, gain = self.changed_files(view, folder)
            # Renders show what LRHS is, and say how many samples they have. Changed ones may not.
            centered = self.is_small_render() or self.change and CHANGES[self.change].centered
            sampling = "auto" if not self.change else "centered" if centered else "nearest"
            options = ["--guides", view.folder / self.guides] if self.guides else []
            if self.change and self.model.reads_hrls:
                options += ["--lrhs-spp", view.spp(self.lrhs), "--hrls-spp", view.spp(self.hrls)]
            report = fuse(program, self.model, lrhs, hrls, folder / "fused.exr", sampling, options)
            return read(folder / "fused.exr") * gain, report["device_ms"] / 1000

    def noisy(self, view):
        """Returns color, albedo and normal of the render that a denoiser reads."""
        return layers(view.folder / self.hrls, ("color", "albedo", "normal"))

    def image(self, view, program):
        """Returns (image, seconds); a denoiser's are without reading its inputs."""
        if self.method == "fused":
            return self.fuse(view, program)
        noisy = self.noisy(view) if self.method in (*FILTERS, "oidn") else None
        start = time.perf_counter()
        if self.method == "half":
            result = read(view.folder / test_set.HALVES[0])
        elif self.method == "render":
            result = read(view.folder / self.hrls)
        elif self.method == "renders":
            result = sum(spp * read(view.folder / test_set.render(spp)) for spp in test_set.PLAIN) / test_set.ALL_PLAIN
        elif self.method in FILTERS:
            result = FILTERS[self.method](*noisy, self.parameters())
        elif self.method == "oidn":
            result = oidn.denoise(oidn.weights(), *noisy)
        else:
            low = read(view.folder / self.lrhs)
            scale = view.reference().shape[0] // low.shape[0]
            result = bicubic(low, scale, (scale - 1) / 2 if self.is_small_render() else 0)
        return result, time.perf_counter() - start


def fuse(program, model, lrhs, hrls, output, sampling="centered", options=(), launcher=(), environment=None):
    """Fuses, or denoises HRLS or upscales LRHS alone, as the model does, and returns the program's report.

    `launcher` is the command that starts the program, if any.
    """
    inputs = ["--lrhs", lrhs, "--lrhs-sampling", sampling] if model.reads_lrhs else []
    inputs += ["--hrls", hrls] if model.reads_hrls else []
    does = "upscale" if not model.reads_hrls else "fuse" if model.reads_lrhs else "denoise"
    command = [*launcher, program, does, *inputs, "--json", "--output-type", "float"]
    command += ["--model", model.path.resolve(), "-o", output, *options]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, env=environment)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}: {done.stderr}")
    return json.loads(done.stdout)


class Score(NamedTuple):
    psnr: float
    relmse: float
    seconds: float


class Store:
    """Keeps the scores in a CSV file, which grows by a line with each measurement."""

    COLUMNS = ("key", "view", "method", "model", "lrhs", "hrls", "guides", "change", *Score._fields)

    def __init__(self, path, program):
        self.path, self.program, self.scores = path, program, {}
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            self.append(self.COLUMNS)
        with open(path, newline="") as file:
            for row in csv.DictReader(file):
                self.scores[row["key"]] = Score(*(float(row[name]) for name in Score._fields))

    def append(self, row):
        with open(self.path, "a", newline="") as file:
            csv.writer(file, lineterminator="\n").writerow(row)

    def get(self, job, view):
        """Returns the score, or None if it was not measured."""
        return self.scores.get(job.key(view)) if job else None

    def measure(self, job, view):
        image, seconds = job.image(view, self.program)
        reference = view.reference(job.halves())
        score = Score(psnr(image, reference), relmse(image, reference), seconds)
        self.scores[job.key(view)] = score
        what = (view.name, job.method, job.model.name if job.model else "", job.lrhs, job.hrls, job.guides, job.change)
        self.append((job.key(view), *what, f"{score.psnr:.4f}", f"{score.relmse:.6f}", f"{seconds:.3f}"))
        return score

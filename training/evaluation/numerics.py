#!/usr/bin/python3
"""How far the program is from the same network in float64: bench/quality/numerics.csv and docs/numerics.md.

Every precision, choice of kernels and class of inputs, for the shipped models and for two whose weights are chosen
to be hard on 16 bits. What the file has already is not measured again: delete its rows for that. With --driver also by cooperative matrices, which Debian sid's Mesa has for CPUs:
scripts/unpack sid build/sid mesa-vulkan-drivers, then --driver build/sid/run.
"""

import argparse
import csv
import dataclasses
import itertools
import math
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

import numpy
import torch

import loss
import model as networks
from evaluation import adversarial, agreement, numerics_pages
from evaluation.images import psnr, read
from evaluation.input_classes import BY_NAME, CLASSES, HARDEST, crop, pair
from evaluation.jobs import Model, fuse
from evaluation.kernel_choices import CHOICES, MATRICES

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
SHIPPED = ("x4-fast", "x4-balanced", "x2-fast", "x8-fast")
MODELS = (*SHIPPED, *adversarial.CONFIGS)
PYTORCH = "PyTorch"  # in the place of the kernels' name: the same network in single precision, for scale
RUNS = [("fp32", PYTORCH), *((one.precision, one.name) for one in (*CHOICES, MATRICES))]
GREY = 0.18  # what the mean of LRHS is exposed to
EXPOSED = networks.Config(exposure_key=GREY)
FLOOR = 0.01  # of the mean: errors of darker pixels are relative to that


@dataclasses.dataclass
class Result:
    """A run of the program beside float64. Relative errors as in relative(); PSNR in dB, None without a reference."""

    model: str
    input: str
    precision: str
    kernels: str
    outcome: str  # fused, or what the program said
    largest_activation: float
    max_relative: float = None
    p999_relative: float = None
    max_steps: float = None  # of an 8-bit sRGB picture
    not_finite: int = None  # values of the image
    saturated: int = None  # values within the network
    psnr_float64: float = None
    psnr_shift: float = None

    def key(self):
        return self.model, self.input, self.precision, self.kernels

    def place(self):
        """Among the rows of the file, whenever each was measured."""
        return MODELS.index(self.model), list(BY_NAME).index(self.input), RUNS.index((self.precision, self.kernels))


def relative(image, exact, exposure):
    """|difference| over |exact| + FLOOR of the mean that the exposure tells; what is not finite is infinitely off."""
    error = (image - exact).abs() / (exact.abs() + FLOOR * GREY / exposure)
    return torch.where(image == exact, 0.0, torch.nan_to_num(error, nan=math.inf, posinf=math.inf))


def steps(image, exact, exposure):
    """The largest difference of pictures in sRGB, in 1/255, exposed."""
    shown = [loss.srgb(torch.nan_to_num(x, nan=0.0) * exposure) for x in (image, exact)]
    return 255 * float((shown[0] - shown[1]).abs().max())


def saturated(report):
    """Values within the network that 16 bits could not hold, as the program counts them."""
    return sum(warning["count"] for warning in report["warnings"] if "within the network" in warning["message"])


class Study:
    """Of pairs in `data`; `folder` is for what is temporary, `cache` for drivers' compiled kernels."""

    def __init__(self, program, data, folder, cache, driver=None):
        self.program, self.data, self.folder, self.cache, self.driver = program, data, folder, cache, driver
        self.numbers = itertools.count()  # of files: OpenImageIO may take a new file for an old one of its name

    def inputs(self, scale, name):
        """The files (LRHS, HRLS) of an input class."""
        paths = tuple(self.folder / f"{which} {next(self.numbers)}.exr" for which in ("lrhs", "hrls"))
        for exr, path in zip(pair(self.data, scale, name), paths):
            exr.write(path)
        return paths

    def psnr(self, image, name):
        """To the reference; None where it says nothing about this class."""
        if BY_NAME[name].gain is None:
            return None
        reference = crop(self.data / "reference.exr").pixels
        return psnr(torch.nan_to_num(image * BY_NAME[name].gain, nan=0.0).permute(1, 2, 0).numpy(), reference)

    def fused(self, model, files, choice):
        """(image [3, H, W] in float64, values that saturated)"""
        output = self.folder / f"fused {next(self.numbers)}.exr"
        # 16 bits are to overflow here.
        options = ["--precision", choice.precision, "--overflow", "warn", *choice.options]
        start = choice.start(self.program, self.cache, self.driver)
        report = fuse(self.program, model, *files, output, options=options, **start)
        if choice.uses_matrices and not any("matrix" in kernel["name"] for kernel in report["kernels"]):
            raise RuntimeError("the program did not take the matrices it was told to")
        return torch.from_numpy(read(output)).double().permute(2, 0, 1), saturated(report)

    def measure(self, model, name, choices):
        files = self.inputs(model.scale, name)
        network = agreement.load(model.path)
        exposure = networks.exposure(agreement.layers_of(files[0], ("color",))["color"].double(), EXPOSED)
        exact, magnitudes = agreement.predict_watched(network, *files)
        largest = max(magnitudes.values())
        start = lambda precision, kernels: Result(model.name, name, precision, kernels, "fused", largest)
        single = agreement.predict(network, *files, torch.float32)
        yield self.compared(start("fp32", PYTORCH), single, exact, exposure)
        for choice in choices:
            result = start(choice.precision, choice.name)
            try:
                image, result.saturated = self.fused(model, files, choice)
                yield self.compared(result, image, exact, exposure)
            except RuntimeError as error:
                result.outcome = str(error).strip().splitlines()[-1]
                yield result

    def compared(self, result, image, exact, exposure):
        error = relative(image, exact, exposure)
        result.max_relative, result.p999_relative = float(error.max()), float(numpy.quantile(error, 0.999))
        result.max_steps = steps(image, exact, exposure)
        result.not_finite = int((~image.isfinite()).sum())
        result.psnr_float64 = self.psnr(exact, result.input)
        if result.psnr_float64 is not None:
            result.psnr_shift = self.psnr(image, result.input) - result.psnr_float64
        return result


def write(path, results):
    text = lambda value: "" if value is None else f"{value:.4g}" if isinstance(value, float) else value
    with open(path, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(field.name for field in dataclasses.fields(Result))
        writer.writerows(map(text, dataclasses.astuple(result)) for result in results)


def load(path):
    def value(field, text):
        return text if field.type is str else None if text == "" else field.type(text)

    with open(path, newline="") as file:
        rows = csv.DictReader(file)
        return [Result(**{f.name: value(f, row[f.name]) for f in dataclasses.fields(Result)}) for row in rows]


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=pathlib.Path, default=ROOT / "build/release/raymeld")
    parser.add_argument("--data", type=pathlib.Path, default=ROOT / "data")
    parser.add_argument("--driver", type=pathlib.Path, help="what starts programs on a driver that has matrices")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "bench/quality/numerics.csv")
    parser.add_argument("--cache", type=pathlib.Path, help="folder that keeps drivers' compiled kernels between runs")
    parser.add_argument("--write-docs", action="store_true", help="tables and plots of docs/numerics.md")
    only = parser.add_argument_group("only")
    only.add_argument("--models", nargs="+", choices=MODELS, help="of these names")
    only.add_argument("--inputs", nargs="+", choices=BY_NAME, help="these classes")
    only.add_argument("--quick", action="store_true", help="x4-fast as rendered, writes nothing")
    only.add_argument("--measured", action="store_true", help="measure nothing, write the tables of what there is")
    return parser.parse_args()


def choices_of(model, name, driver):
    """What is measured of an input class: what users get and, of the first model and the hard ones, everything."""
    everything = name in HARDEST and model not in SHIPPED[1:]
    choices = [one for one in CHOICES if everything or not one.kernel]
    return choices + [MATRICES] * (everything and driver is not None)


def measure(args, folder, known):
    """All that is asked for but the keys in `known`; float64 and PyTorch are computed with whatever else is."""
    study = Study(args.program, args.data, folder, args.cache or folder / "cache", args.driver)
    shipped = [Model.load(ROOT / f"models/{name}.safetensors") for name in SHIPPED]
    models = shipped + adversarial.write_all(folder, study.inputs(4, "as rendered"))
    wanted = ["x4-fast"] if args.quick else args.models or MODELS
    for model in (model for model in models if model.name in wanted):
        inputs = [one.name for one in CLASSES] if model.name == SHIPPED[0] else HARDEST
        for name in ["as rendered"] if args.quick else args.inputs or inputs:
            choices = choices_of(model.name, name, args.driver)
            missing = [one for one in choices if (model.name, name, one.precision, one.name) not in known]
            for result in study.measure(model, name, missing) if missing else []:
                print(*(f"{value:.3g}" if isinstance(value, float) else value for value in dataclasses.astuple(result)))
                sys.stdout.flush()
                yield result


def main():
    args = parse()
    torch.set_grad_enabled(False)
    if not args.measured:
        results = {one.key(): one for one in (load(args.out) if args.out.exists() and not args.quick else [])}
        with tempfile.TemporaryDirectory() as folder:
            for result in measure(args, pathlib.Path(folder), set(results)):
                results[result.key()] = result
                if not args.quick:
                    write(args.out, sorted(results.values(), key=Result.place))
    if args.quick:
        return
    if args.write_docs:
        numerics_pages.write(load(args.out), ROOT / "docs")


if __name__ == "__main__":
    main()

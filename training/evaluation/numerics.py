#!/usr/bin/python3
"""Measures how far the program is from the same network in float64: bench/quality/numerics.csv and docs/numerics.md.

It covers every precision, choice of kernels and class of inputs, for the shipped models and for two whose weights are
chosen to be hard on 16 bits. Rows that the file has are not measured again; delete them to repeat a measurement. Given
--driver, it also covers cooperative matrices, which Debian sid's Mesa has for CPUs: run
scripts/unpack sid build/sid mesa-vulkan-drivers, then use --driver build/sid/run.
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
SHIPPED = ("x4-fast", "x4-balanced", "x2-fast", "x2-balanced")
MODELS = (*SHIPPED, *adversarial.CONFIGS)
PYTORCH = "PyTorch"  # replaces the kernels' name for the same network in single precision, which gives the scale
RUNS = [("fp32", PYTORCH), *((one.precision, one.name) for one in (*CHOICES, MATRICES))]
GREY = 0.18  # exposed mean of LRHS
EXPOSED = networks.Config(exposure_key=GREY)
FLOOR = 0.01  # share of the mean that relative errors add to their denominator


@dataclasses.dataclass
class Result:
    """Holds a run of the program beside float64; relative errors are relative()'s, PSNR is None without a reference."""

    model: str
    input: str
    precision: str
    kernels: str
    outcome: str  # "fused", or the program's message
    largest_activation: float
    max_relative: float = None
    p999_relative: float = None
    max_steps: float = None  # largest error in steps of an 8-bit sRGB picture
    not_finite: int = None  # number of values of the image
    saturated: int = None  # number of values within the network
    psnr_float64: float = None  # dB
    psnr_shift: float = None

    def key(self):
        return self.model, self.input, self.precision, self.kernels

    def place(self):
        """Returns the row's place in the file, whenever it was measured."""
        return MODELS.index(self.model), list(BY_NAME).index(self.input), RUNS.index((self.precision, self.kernels))


def relative(image, exact, exposure):
    """Computes |difference| / (|exact| + FLOOR times the mean by `exposure`); values not finite are infinitely off."""
    error = (image - exact).abs() / (exact.abs() + FLOOR * GREY / exposure)
    return torch.where(image == exact, 0.0, torch.nan_to_num(error, nan=math.inf, posinf=math.inf))


def steps(image, exact, exposure):
    """Returns the largest difference of the exposed pictures in sRGB, in steps of 1/255."""
    shown = [loss.srgb(torch.nan_to_num(x, nan=0.0) * exposure) for x in (image, exact)]
    return 255 * float((shown[0] - shown[1]).abs().max())


def saturated(report):
    """Returns how many values within the network 16 bits could not hold, as the program counts them."""
    return sum(warning["count"] for warning in report["warnings"] if "within the network" in warning["message"])


class Study:
    """Measures pairs in `data`; `folder` is for temporary files, `cache` for drivers' compiled kernels."""

    def __init__(self, program, data, folder, cache, driver=None):
        self.program, self.data, self.folder, self.cache, self.driver = program, data, folder, cache, driver
        self.numbers = itertools.count()  # names files, as OpenImageIO may take a new file for an old one of its name

    def inputs(self, scale, name):
        """Writes an input class; returns its files (LRHS, HRLS)."""
        paths = tuple(self.folder / f"{which} {next(self.numbers)}.exr" for which in ("lrhs", "hrls"))
        for exr, path in zip(pair(self.data, scale, name), paths):
            exr.write(path)
        return paths

    def psnr(self, image, name):
        """Computes the PSNR to the reference, or None if the reference says nothing about this class."""
        if BY_NAME[name].gain is None:
            return None
        reference = crop(self.data / "reference.exr").pixels
        return psnr(torch.nan_to_num(image * BY_NAME[name].gain, nan=0.0).permute(1, 2, 0).numpy(), reference)

    def fused(self, model, files, choice):
        """Returns (image [3, H, W] in float64, number of values that saturated)."""
        output = self.folder / f"fused {next(self.numbers)}.exr"
        # The study lets 16 bits overflow, and renders disagree.
        options = ["--precision", choice.precision, "--overflow", "warn", "--pair-check", "off", *choice.options]
        options += ["--profile"] if choice.kernel else []  # tells which kernels were taken
        start = choice.start(self.program, self.cache, self.driver)
        report = fuse(self.program, model, *files, output, options=options, **start)
        if choice.kernel and not any(choice.kernel["algorithm"] in kernel["name"] for kernel in report["kernels"]):
            raise RuntimeError(f"the program did not take the kernels that it was told to, {choice.name}")
        return torch.from_numpy(read(output)).double().permute(2, 0, 1), saturated(report)

    def measure(self, model, name, choices):
        files = self.inputs(model.scale, name)
        network = networks.load(model.path)
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
    parser.add_argument("--driver", type=pathlib.Path, help="command that starts programs on a driver with matrices")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "bench/quality/numerics.csv")
    parser.add_argument("--cache", type=pathlib.Path, help="folder that keeps drivers' compiled kernels between runs")
    parser.add_argument("--write-docs", action="store_true", help="write the tables and plots of docs/numerics.md")
    only = parser.add_argument_group("only")
    only.add_argument("--models", nargs="+", choices=MODELS, help="models to measure")
    only.add_argument("--inputs", nargs="+", choices=BY_NAME, help="input classes to measure")
    only.add_argument("--quick", action="store_true", help="measure x4-fast as rendered, write nothing")
    only.add_argument("--measured", action="store_true", help="measure nothing, write the tables of earlier results")
    return parser.parse_args()


def choices_of(model, name, driver):
    """Returns the choices to measure: those that need no written tuning, and in hard cases all.

    A hard case is a class of HARDEST with the first model or an adversarial one.
    """
    everything = name in HARDEST and model not in SHIPPED[1:]
    choices = [one for one in CHOICES if everything or not one.kernel]
    return choices + [MATRICES] * (everything and driver is not None)


def measure(args, folder, known):
    """Yields the results asked for, except keys in `known`; PyTorch is measured again with every other result."""
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

#!/usr/bin/env python3
"""Draws the validation curves of trained models: curves.py OUT.png NAME.csv..."""

import csv
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot


def main():
    out, *paths = sys.argv[1:]
    figure, axes = pyplot.subplots(figsize=(7, 4), layout="constrained")
    for path in map(pathlib.Path, paths):
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        axes.plot([float(r["minutes"]) for r in rows], [float(r["psnr"]) for r in rows], label=path.stem)
    axes.set(xlabel="training, minutes a thread", ylabel="validation PSNR, dB")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(out, dpi=110)


main()

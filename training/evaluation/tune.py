#!/usr/bin/python3
"""Tunes a filter of filters.py, parameter by parameter, on packed training views: tune.py VIEWS FILTER [COUNT]."""

import dataclasses
import pathlib
import sys

import numpy
import torch

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))
import dataset
from evaluation.filters import FILTERS, TUNED
from evaluation.images import psnr, relmse

STEPS = (2.0, 1.4)
WORTHWHILE_DB = 0.005


def load(view, spp):
    """Returns (reference, (color, albedo, normal)) of a packed view."""
    return view.reference()[:3].permute(1, 2, 0).numpy(), view.noisy(spp)


def score(denoise, views, parameters):
    """Returns the means of PSNR and of RelMSE in decibels, which may be summed: no scene outweighs another."""
    images = [(denoise(*render, parameters), reference) for reference, render in views]
    return numpy.mean([(psnr(*pair), -10 * numpy.log10(relmse(*pair))) for pair in images], axis=0)


def tune(denoise, views, best):
    best_score = score(denoise, views, best)
    show(best, best_score)
    for step in STEPS:
        for name in dataclasses.asdict(best):
            for ratio in (step, 1 / step):
                while True:
                    candidate = dataclasses.replace(best, **{name: float(f"{getattr(best, name) * ratio:.3g}")})
                    candidate_score = score(denoise, views, candidate)
                    if candidate_score.sum() <= best_score.sum() + WORTHWHILE_DB:
                        break
                    best, best_score = candidate, candidate_score
                    show(best, best_score)


def show(parameters, scores):
    print(f"PSNR {scores[0]:.3f}, RelMSE {-scores[1]:.3f} dB", parameters, flush=True)


def main():
    torch.set_num_threads(1)
    name, count = sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 20
    views = dataset.load(sys.argv[1])[0]
    views = views[:: max(1, len(views) // count)][:count]
    for spp, best in TUNED[name].items():
        print(f"{name}, {spp} spp, {len(views)} views")
        tune(FILTERS[name], [load(view, spp) for view in views], best)


if __name__ == "__main__":
    main()

#!/usr/bin/python3
"""Tunes the a-trous filter, parameter by parameter, on training views: tune.py VIEWS [COUNT]."""

import dataclasses
import pathlib
import sys

import numpy
import torch

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))
from evaluation import test_set
from evaluation.baselines import TUNED, atrous
from evaluation.images import layers, psnr, relmse

STEPS = (2.0, 1.4)
WORTHWHILE_DB = 0.005


def load(view, spp):
    """(reference, (color, albedo, normal))"""
    return view.reference(), layers(view.folder / test_set.render(spp), ("color", "albedo", "normal"))


def score(views, parameters):
    """Mean of PSNR and of RelMSE in decibels, to be summed: no scene outweighs another."""
    images = [(atrous(*render, parameters), reference) for reference, render in views]
    return numpy.mean([(psnr(*pair), -10 * numpy.log10(relmse(*pair))) for pair in images], axis=0)


def tune(views, best):
    best_score = score(views, best)
    for step in STEPS:
        for name in dataclasses.asdict(best):
            for ratio in (step, 1 / step):
                while True:
                    candidate = dataclasses.replace(best, **{name: float(f"{getattr(best, name) * ratio:.3g}")})
                    candidate_score = score(views, candidate)
                    if candidate_score.sum() <= best_score.sum() + WORTHWHILE_DB:
                        break
                    best, best_score = candidate, candidate_score
                    print(f"PSNR {best_score[0]:.3f}, RelMSE {-best_score[1]:.3f} dB", best, flush=True)


def main():
    torch.set_num_threads(1)
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 20
    views = test_set.load(sys.argv[1])
    views = views[:: max(1, len(views) // count)][:count]
    for spp, best in TUNED.items():
        print(f"{spp} spp")
        tune([load(view, spp) for view in views], best)


main()

#!/usr/bin/python3
"""Tunes the a-trous filter, parameter by parameter, on training views: tune.py VIEWS [COUNT [SPP ...]]."""

import dataclasses
import pathlib
import sys

import numpy
import torch

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))
from evaluation import test_set
from evaluation.baselines import Atrous, atrous
from evaluation.images import layers, psnr, relmse

STEPS = (2.0, 1.4)
WORTHWHILE_DB = 0.005


def load(view, counts):
    """(reference, [(color, albedo, normal) by spp])"""
    return view.reference(), [layers(view.folder / test_set.render(n), ("color", "albedo", "normal")) for n in counts]


def score(views, parameters):
    """Mean of PSNR and of RelMSE in decibels, summed: no scene outweighs another."""
    scores = []
    for reference, renders in views:
        for render in renders:
            image = atrous(*render, parameters)
            scores.append((psnr(image, reference), -10 * numpy.log10(relmse(image, reference))))
    return numpy.mean(scores, axis=0)


def tune(views, best=Atrous()):
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
    count, *counts = map(int, sys.argv[2:] or [10])
    views = test_set.load(sys.argv[1])
    step = max(1, len(views) // count)
    tune([load(view, counts or test_set.AVERAGES) for view in views[::step][:count]])


main()

"""Measures what it costs to make an image, as Table 4 of Hou et al. 2021 does."""

import os
import statistics
from unittest import mock

from evaluation import tables
from evaluation.jobs import Job
from evaluation.test_set import render

ROUNDS = 3


def jobs(models):
    """Returns (label, job) with the pair of two samples a pixel together; an LRHS alone has one."""
    denoisers = [(tables.DENOISERS[method], Job(method, hrls=render(2))) for method in ("svgf", "nfor", "oidn")]
    return denoisers + [(model.name, tables.base(model)) for model in models]


def sheet(models, view, program):
    """Measures all in turns, each in one thread, and returns the medians."""
    with mock.patch.dict(os.environ, LP_NUM_THREADS="0"):  # Mesa's driver for CPUs then has one thread
        times = [[job.image(view, program)[1] for _, job in jobs(models)] for _ in range(ROUNDS)]
    medians = [statistics.median(column) for column in zip(*times)]
    least = min(medians)
    rows = [[label, f"{time:.2f}", f"{time / least:.1f}"] for (label, _), time in zip(jobs(models), medians)]
    return tables.Sheet("cost", ["", "seconds", "times the fastest"], rows)

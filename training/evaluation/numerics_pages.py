"""Writes the tables and plots of docs/numerics.md from the results of numerics.py."""

import itertools
import math

from evaluation.tables import Sheet, insert

VISIBLE = 1.0  # steps of an 8-bit picture from which an image counts as off
COLOURS = {"fp32": "#c0392b", "fp16": "#e59866"}
MARKERS = {"direct": "o", "F(2, 3)": "s", "auto": "D", "matrices": "^", "PyTorch": "x"}
LEAST = 1e-9  # left edge of plots, as an error of 0 has no logarithm


def number(value, form):
    return "" if value is None else "infinite" if math.isinf(value) else form.format(value)


def label(result):
    return f"{result.precision} {result.kernels}"


def unique(values):
    return list(dict.fromkeys(values))


def runs_of(results):
    """Returns the labels of the results, those of 32 bits first."""
    return sorted(unique(map(label, results)), key=lambda text: not text.startswith("fp32"))


def errors(result):
    """Returns the two errors as text, or the outcome that there is instead."""
    if result.outcome != "fused":
        return "refused"
    if result.max_relative == 0:
        return "0"
    return f"{number(result.max_relative, '{:.0e}')} / {number(result.p999_relative, '{:.0e}')}"


def inputs_sheet(results):
    """Makes a table of the model that was measured with everything: largest error and 99.9th percentile by class."""
    own = [one for one in results if one.model == results[0].model]
    columns = runs_of(own)
    rows = []
    for name in unique(one.input for one in own):
        cells = {label(one): errors(one) for one in own if one.input == name}
        rows.append([name, *(cells.get(column, "") for column in columns)])
    return Sheet("numerics-inputs", [results[0].model, *columns], rows)


def worst(results, measure, form):
    """Returns the largest value of a measure and its input class."""
    known = [one for one in results if getattr(one, measure) is not None]
    if not known:
        return ""
    one = max(known, key=lambda one: abs(getattr(one, measure)))
    return f"{number(getattr(one, measure), form)} {one.input}"


def models_sheet(results):
    head = ["", "classes", "99.9 % of errors", "the worst", "steps of 8 bits", "the worst"]
    head += ["PSNR of float64", "shift", "the worst"]
    rows = []
    for key in itertools.product(unique(one.model for one in results), runs_of(results)):
        own = [one for one in results if (one.model, label(one)) == key]
        if not own:
            continue
        first = next(one for one in own if one.input == "as rendered")
        cells = [str(len(own)), number(first.p999_relative, "{:.1e}"), worst(own, "p999_relative", "{:.1e}")]
        cells += [number(first.max_steps, "{:.3g}"), worst(own, "max_steps", "{:.3g}")]
        cells += [number(first.psnr_float64, "{:.2f}"), number(first.psnr_shift, "{:+.0e}")]
        rows.append([", ".join(key), *cells, worst(own, "psnr_shift", "{:+.0e}")])
    return Sheet("numerics-models", head, rows)


def is_broken(result):
    if result.outcome != "fused":
        return True
    return result.not_finite > 0 or result.max_steps >= VISIBLE or bool(result.saturated)


def broken_sheet(results):
    head = ["model", "class", "run", "largest activation", "steps of 8 bits", "99.9 % of errors", "PSNR shift"]
    head += ["saturated", "not finite"]
    rows = []
    for one in filter(is_broken, results):
        who = [one.model, one.input, label(one), number(one.largest_activation, "{:.1e}")]
        if one.outcome != "fused":
            rows.append([*who, one.outcome, "", "", "", ""])
            continue
        cells = [number(one.max_steps, "{:.1f}"), number(one.p999_relative, "{:.1e}")]
        cells += [number(one.psnr_shift, "{:+.2f}"), str(one.saturated or ""), str(one.not_finite or "")]
        rows.append([*who, *cells])
    return Sheet("numerics-broken", head, rows)


def subplots(rows, height):
    """Returns (figure, axes) with space for `rows` rows of `height` inches."""
    # Only plots need matplotlib, so that tests of the tables run without it.
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "raymeld"
    return plt.subplots(figsize=(9, height * rows + 1.2))


def save(figure, path):
    """Saves the same file from the same results: without the time, and with `svg.hashsalt`."""
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})


def plot_inputs(results, path):
    """Plots the largest error of each class, for the model that was measured with everything."""
    own = [one for one in results if one.model == results[0].model and one.outcome == "fused"]
    names = unique(one.input for one in own)
    figure, axes = subplots(len(names), 0.24)
    for key in runs_of(own):
        runs = [one for one in own if label(one) == key]
        x = [min(max(one.max_relative, LEAST), 1e3) for one in runs]
        y = [names.index(one.input) for one in runs]
        style = dict(marker=MARKERS[runs[0].kernels], color=COLOURS[runs[0].precision])
        axes.scatter(x, y, s=22, label=key, linewidths=0.8, **style)
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlabel(f"largest relative error from float64, {results[0].model} (left edge: none)")
    axes.grid(True, axis="x", alpha=0.3)
    axes.legend(fontsize=7)
    save(figure, path)


def plot_models(results, path):
    """Plots every class of every model as a dot at its largest error, in steps of an 8-bit picture."""
    own = [one for one in results if one.outcome == "fused" and one.kernels in ("direct", "auto")]
    keys = list(itertools.product(unique(one.model for one in own), runs_of(own)))
    figure, axes = subplots(len(keys), 0.3)
    for one in own:
        x = min(max(one.max_steps, 1e-5), 255)
        colour = COLOURS[one.precision]
        axes.plot(x, keys.index((one.model, label(one))), MARKERS[one.kernels], color=colour, markersize=4, alpha=0.7)
    axes.axvline(VISIBLE, color="black", linewidth=0.8)
    axes.set_yticks(range(len(keys)), [", ".join(key) for key in keys], fontsize=8)
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlabel("largest error of a class of inputs, in steps of an 8-bit sRGB picture")
    axes.grid(True, axis="x", alpha=0.3)
    save(figure, path)


def write(results, docs):
    plot_inputs(results, docs / "numerics-inputs.svg")
    plot_models(results, docs / "numerics-models.svg")
    page = docs / "numerics.md"
    sheets = [make(results) for make in (inputs_sheet, models_sheet, broken_sheet)]
    page.write_text(insert(page.read_text(), sheets))

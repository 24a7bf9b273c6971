"""The tables and plots of docs/numerics.md, from what numerics.py measured."""

import math

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from evaluation.tables import Sheet, insert

VISIBLE = 1.0  # steps of an 8-bit picture from which an image counts as off
COLOURS = {"fp32": "#c0392b", "fp16": "#e59866"}
MARKERS = {"direct": "o", "F(2, 3)": "s", "auto": "D", "matrices": "^", "PyTorch": "x"}
LEAST = 1e-9  # where plots begin: an error of 0 has no logarithm


def number(value, form):
    return "" if value is None else "infinite" if math.isinf(value) else form.format(value)


def label(result):
    return f"{result.precision} {result.kernels}"


def unique(values):
    return list(dict.fromkeys(values))


def errors(result):
    """Two numbers, or what happened instead."""
    if result.outcome != "fused":
        return "refused"
    if result.max_relative == 0:
        return "0"
    return f"{number(result.max_relative, '{:.0e}')} / {number(result.p999_relative, '{:.0e}')}"


def inputs_sheet(results):
    """Of the model that was measured with everything: the largest error and the 99.9th percentile."""
    own = [one for one in results if one.model == results[0].model]
    columns = unique(map(label, own))
    rows = []
    for name in unique(one.input for one in own):
        cells = {label(one): errors(one) for one in own if one.input == name}
        rows.append([name, *(cells.get(column, "") for column in columns)])
    return Sheet("numerics-inputs", [results[0].model, *columns], rows)


def worst(results, measure):
    """(its text, the input class) of the result whose measure is largest."""
    known = [one for one in results if getattr(one, measure) is not None]
    return max(known, key=lambda one: abs(getattr(one, measure)), default=None)


def models_sheet(results):
    head = ["", "largest activation", "99.9 % of errors, as rendered", "worst class", "in steps of 8 bits", "worst class"]
    head += ["PSNR of float64, as rendered", "shift", "largest shift", "of class", "saturated"]
    rows = []
    for key in unique((one.model, label(one)) for one in results):
        own = [one for one in results if (one.model, label(one)) == key and one.outcome == "fused"]
        if not own:
            continue
        first, error, steps, shift = own[0], *(worst(own, m) for m in ("p999_relative", "max_steps", "psnr_shift"))
        cells = [number(first.largest_activation, "{:.2g}"), number(first.p999_relative, "{:.1e}")]
        cells += [f"{number(error.p999_relative, '{:.1e}')} {error.input}", number(first.max_steps, "{:.2f}")]
        cells += [f"{number(steps.max_steps, '{:.2f}')} {steps.input}", number(first.psnr_float64, "{:.2f}")]
        cells += [number(first.psnr_shift, "{:+.4f}"), number(shift.psnr_shift, "{:+.4f}"), shift.input]
        rows.append([", ".join(key), *cells, str(max(one.saturated or 0 for one in own) or "")])
    return Sheet("numerics-models", head, rows)


def is_broken(result):
    if result.outcome != "fused":
        return True
    return result.not_finite > 0 or result.max_steps >= VISIBLE or bool(result.saturated)


def broken_sheet(results):
    head = ["model", "class", "run", "steps of 8 bits", "99.9 % of errors", "PSNR shift", "saturated", "not finite"]
    rows = []
    for one in filter(is_broken, results):
        if one.outcome != "fused":
            rows.append([one.model, one.input, label(one), one.outcome, "", "", "", ""])
            continue
        cells = [number(one.max_steps, "{:.1f}"), number(one.p999_relative, "{:.1e}")]
        cells += [number(one.psnr_shift, "{:+.2f}"), str(one.saturated or ""), str(one.not_finite or "")]
        rows.append([one.model, one.input, label(one), *cells])
    return Sheet("numerics-broken", head, rows)


def plot_inputs(results, path):
    """The largest error of each class, of the model that was measured with everything."""
    own = [one for one in results if one.model == results[0].model and one.outcome == "fused"]
    names = unique(one.input for one in own)
    figure, axes = plt.subplots(figsize=(9, 0.24 * len(names) + 1.2))
    for key in unique(map(label, own)):
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
    figure.tight_layout()
    figure.savefig(path)


def plot_models(results, path):
    """Every class of every model as a dot, by what is seen of the error."""
    own = [one for one in results if one.outcome == "fused" and one.kernels in ("direct", "auto")]
    keys = unique((one.model, label(one)) for one in own)
    figure, axes = plt.subplots(figsize=(9, 0.3 * len(keys) + 1.2))
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
    figure.tight_layout()
    figure.savefig(path)


def write(results, docs):
    plt.rcParams["svg.hashsalt"] = "raymeld"  # the same file from the same results
    plot_inputs(results, docs / "numerics-inputs.svg")
    plot_models(results, docs / "numerics-models.svg")
    page = docs / "numerics.md"
    sheets = [make(results) for make in (inputs_sheet, models_sheet, broken_sheet)]
    page.write_text(insert(page.read_text(), sheets))

"""Says which images make which table, and writes tables as CSV and Markdown."""

import csv
import dataclasses
import re
import statistics

import numpy

from evaluation.changes import EXPOSURES
from evaluation.jobs import Job, Score
from evaluation.test_set import ALL_PLAIN, AVERAGES, HALVES, PAIRS, PAPER_PAIRS, PLAIN, decimated, guides, lrhs, render

# These make an image of a plain render.
DENOISERS = {
    "atrous": "a-trous filter",
    "svgf": "SVGF-like filter",
    "nfor": "NFOR-like regression",
    "oidn": "Open Image Denoise",
}
BASELINES = ("render", "atrous", "bicubic")
# A sheet of leads has these pairs, and compares with the best of these baselines in the same view.
LEADS = {
    "lead": (PAIRS, BASELINES),
    "lead-svgf": (PAIRS, ("svgf",)),
    "paper-lead-svgf": (PAPER_PAIRS, ("svgf",)),
    "lead-oidn": (PAIRS, ("oidn",)),
}


@dataclasses.dataclass
class Plan:
    """Holds a table whose cells are jobs, None where there is nothing to measure."""

    name: str
    head: str
    columns: list
    rows: list  # (label, [job for each column])

    def jobs(self):
        return [job for _, row in self.rows for job in row if job]


@dataclasses.dataclass
class Sheet:
    """Holds a table of texts and Scores, None where something is still to be measured."""

    name: str
    head: list
    rows: list

    def markdown(self):
        lines = [self.head, ["---"] * len(self.head), *([text(cell) for cell in row] for row in self.rows)]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines)

    def write_csv(self, folder):
        scores = [any(isinstance(row[i], Score) for row in self.rows) for i in range(len(self.head))]
        head = [[f"{name} PSNR", f"{name} RelMSE"] if two else [name] for name, two in zip(self.head, scores)]
        with open(folder / f"{self.name}.csv", "w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(sum(head, []))
            for row in self.rows:
                writer.writerow(sum((csv_cells(cell, two) for cell, two in zip(row, scores)), []))


def text(cell):
    if isinstance(cell, Score):
        return f"{cell.psnr:.2f} / {cell.relmse:.4f}"
    return str(cell or "")


def csv_cells(cell, two):
    if isinstance(cell, Score):
        return [f"{cell.psnr:.3f}", f"{cell.relmse:.5f}"]
    return [cell or "", ""] if two else [cell or ""]


def mean(job, views, store):
    """Returns the mean score, or None unless all views were measured: means over different views cannot be compared."""
    scores = [store.get(job, view) for view in views]
    return Score(*numpy.mean(scores, axis=0)) if scores and all(scores) else None


def sheet(plan, views, store):
    rows = [[label, *(mean(job, views, store) for job in row)] for label, row in plan.rows]
    return Sheet(plan.name, [plan.head, *plan.columns], rows)


def fused(model, pair, change="", scale=None, lrhs=lrhs):
    """Returns the job with the pair of `scale`, by default the model's; `lrhs` or decimated() names the small image."""
    hrls = render(pair[1]) if model.reads_hrls else ""
    return Job("fused", lrhs(scale or model.scale, pair[0]), hrls, model, change)


def base(model, change="", lrhs=lrhs):
    """Returns the job with the pair of two samples a pixel together."""
    return fused(model, PAIRS[model.scale][0], change, lrhs=lrhs)


def bicubic(scale, pair):
    return Job("bicubic", lrhs(scale, pair[0]))


def pair_text(low, high):
    return f"{low}-{high}" if low else f"{high} alone"


def pairs_text(pairs):
    return ", ".join(pair_text(*pair) for pair in pairs)


def scales(model):
    """Returns the scales of the pairs that a model fuses."""
    return (4, 8) if model.scale == 4 else (model.scale,)


def pairings(models, pairs=PAIRS):
    """Returns (model, scale of the pair, pair, its place in AVERAGES) for all that is compared at equal samples."""
    both = [(model, scale) for model in models for scale in scales(model)]
    both.sort(key=lambda one: one[1])
    return [(model, scale, pair, i) for model, scale in both for i, pair in enumerate(pairs[scale])]


def label(model, scale, pair):
    return f"{model.name}, {'' if scale == model.scale else f'x{scale}, '}{pair_text(*pair)}"


def main_plan(models, name="main", pairs=PAIRS):
    rows = [
        ("the reference's own noise", [Job("half")] * 3),
        ("plain render", [Job("render", hrls=render(spp)) for spp in AVERAGES]),
    ]
    for method, what in DENOISERS.items():
        rows.append((f"{what} of it", [Job(method, hrls=render(spp)) for spp in AVERAGES]))
    for scale in sorted({scale for model in models for scale in scales(model)}):
        if scale > 1:
            rows.append((f"bicubic of LRHS, x{scale}", [bicubic(scale, pair) for pair in pairs[scale]]))
        for model in models:
            if scale in scales(model):
                what = f"{model.name}, x{scale}" if scale != model.scale else model.name
                jobs = [fused(model, pair, scale=scale) for pair in pairs[scale]]
                rows.append((f"{what} ({pairs_text(pairs[scale])})", jobs))
    return Plan(name, "", [f"{spp} spp" for spp in AVERAGES], rows)


def decimated_plan(models):
    rows = []
    for model in models:
        pairs = PAPER_PAIRS[model.scale]
        rows.append((f"{model.name} ({pairs_text(pairs)})", [fused(model, pair, lrhs=decimated) for pair in pairs]))
    return Plan("decimated", "", [f"{spp} spp" for spp in AVERAGES], rows)


def grid_plan(model):
    columns = (1, 2, 4, 8)
    cells = lambda low: [fused(model, (low, high)) if high < low else None for high in columns]
    rows = [(f"{low} spp", cells(low)) for low in (4, 8, 16, 32, 64)]
    return Plan(f"grid-{model.name}", "LRHS \\ HRLS", [f"{spp} spp" for spp in columns], rows)


# A model that was trained without an input is measured with this change of its inputs, these samples and this label.
# The samples of LRHS are those for each full-size pixel that it covers.
ABLATIONS = {
    "none": ("", ((1, 1),), "{0}-{1}"),
    "hrls": ("no-hrls", ((1, 1), (2, 1)), "LRHS alone, {0} spp"),
    "lrhs": ("no-lrhs", tuple((1, spp) for spp in AVERAGES), "HRLS alone, {1} spp"),
    "layers": ("rgb", ((1, 1),), "{0}-{1}"),
}


def ablation_plan(models, ablations):
    """Plans the ablations; `ablations` are models whose `training` says what they were trained without."""
    firsts = [(scale, PAIRS[scale][0]) for scale in sorted({model.scale for model in ablations})]
    rows = [(f"bicubic of LRHS, x{scale}, {first[0]} spp", bicubic(scale, first)) for scale, first in firsts]
    for model in models:
        first = PAIRS[model.scale][0]
        rows.append((f"{model.name}, {first[0]}-{first[1]}", base(model)))
        rows.append((f"{model.name}, given RGB only", base(model, "rgb")))
    for model in ablations:
        change, shares, label = ABLATIONS[model.trained("without")]
        pairs = [(low * model.scale**2, high) for low, high in shares]
        rows += [(f"{model.name}, {label.format(*pair)}", fused(model, pair, change)) for pair in pairs]
    return Plan("ablations", "", ["PSNR / RelMSE"], [(label, [job]) for label, job in rows])


def robustness_plan(models):
    last = {2: (16, 8), 4: (64, 8), 8: (256, 8)}
    changes = [f"exposure {stops:+}" for stops in EXPOSURES] + ["fireflies", "alpha"]
    labels = [f"both inputs x 2^{stops}, result / 2^{stops}" for stops in EXPOSURES]
    labels += ["fireflies: 0.1 % of the HRLS pixels x 1000", "alpha: a ramp from 0 to 1"]
    rows = [("as in training, 2 spp together", [base(model) for model in models])]
    rows += [(label, [base(model, change) for model in models]) for label, change in zip(labels, changes)]
    rows += [
        ("LRHS is every s-th pixel of a full-size render", [base(model, lrhs=decimated) for model in models]),
        ("most samples (16-8, 64-8, 256-8)", [fused(model, last[model.scale]) for model in models]),
        (
            "LRHS of half the reference, 8 spp HRLS",
            [Job("fused", HALVES[0], render(8), model, "subsampled") for model in models],
        ),
    ]
    return Plan("robustness", "", [model.name for model in models], rows)


def rival(method, scale, pair, i):
    """Returns the baseline's job: bicubic upsampling of the pair's LRHS, or a plain render of AVERAGES[i] samples."""
    return bicubic(scale, pair) if method == "bicubic" else Job(method, hrls=render(AVERAGES[i]))


def lead(model, scale, pair, i, view, store, rivals):
    """Returns (decibels, RelMSE of the best baseline over the model's), or None if one of them was not measured."""
    rivals = [method for method in rivals if scale > 1 or method != "bicubic"]  # there is no LRHS
    jobs = [fused(model, pair, scale=scale), *(rival(method, scale, pair, i) for method in rivals)]
    scores = [store.get(job, view) for job in jobs]
    if not all(scores):
        return None
    own, *others = scores
    return own.psnr - max(s.psnr for s in others), min(s.relmse for s in others) / own.relmse


def first_lead(model, view, store, rivals=BASELINES):
    """Returns the lead() with two samples a pixel together."""
    return lead(model, model.scale, PAIRS[model.scale][0], 0, view, store, rivals)


def spread(decibels):
    """Returns the texts of the median, the least and the most."""
    return [f"{value:+.2f}" for value in (statistics.median(decibels), min(decibels), max(decibels))]


def upscale_plan(models):
    """Plans the table of images that LRHS alone makes, with as many samples as 1, 2 and 4 a full-size pixel."""
    rows = []
    for scale in sorted({model.scale for model in models}):
        pairs = PAPER_PAIRS[scale]
        rows.append((f"bicubic, x{scale}", [bicubic(scale, pair) for pair in pairs]))
        for model in (model for model in models if model.scale == scale):
            rows.append((model.name, [fused(model, pair) for pair in pairs]))
    return Plan("upscale", "", [f"{high} spp" for _, high in PAPER_PAIRS[2]], rows)


def best_plan(models):
    """Plans Table 5 of Hou et al. 2021: LRHS alone or with one sample of HRLS.

    The last column has the best LRHS there is, which is half of the reference, averaged over s x s pixels.
    """
    rows = []
    for model in models:
        rows.append((model.name, [base(model), Job("fused", HALVES[0], render(1), model, "averaged")]))
    return Plan("best-lrhs", "", ["LRHS of 4 (x2) or 16 samples (x4)", "the best LRHS"], rows)


def lead_sheet(name, models, views, store):
    rows, (pairs, rivals) = [], LEADS[name]
    for model, scale, pair, i in pairings(models, pairs):
        leads = [lead(model, scale, pair, i, view, store, rivals) for view in views]
        if not leads or not all(leads):
            continue
        psnr, relmse = zip(*leads)
        ahead = [f"{sum(p > 0 for p in psnr)} of {len(views)}", f"{sum(r > 1 for r in relmse)} of {len(views)}"]
        rows.append([label(model, scale, pair), *ahead, *spread(psnr), f"{statistics.median(relmse):.2f}"])
    head = ["", "ahead in PSNR", "ahead in RelMSE", "lead, median dB", "least", "most", "RelMSE / own, median"]
    return Sheet(name, head, rows)


def scenes_sheet(models, views, store):
    """Makes the table of views for x4 at two samples a pixel together; the other scales would make it too wide."""
    jobs = [("own noise", Job("half")), ("render, 2 spp", Job("render", hrls=render(2)))]
    jobs += [("a-trous, 2 spp", Job("atrous", hrls=render(2))), ("SVGF-like, 2 spp", Job("svgf", hrls=render(2)))]
    jobs += [("bicubic x4", bicubic(4, PAIRS[4][0]))]
    jobs += [(model.name, base(model)) for model in models if model.scale == 4]
    rows = [[f"{v.name[5:]} {v.record['kind']}", *(store.get(job, v) for _, job in jobs)] for v in views]
    return Sheet("scenes", ["view", *(name for name, _ in jobs)], rows)


def filtered_psnr(view, store, seconds):
    """Returns the PSNR of the SVGF-like filter of a plain render that takes so many seconds, None if not measured.

    It is interpolated over the logarithm of time between 2, 4 and 8 samples a pixel, and extrapolated beyond them.
    """
    scores = [store.get(Job("svgf", hrls=render(spp)), view) for spp in AVERAGES]
    if not all(scores):
        return None
    times, psnrs = numpy.log([view.seconds(spp) for spp in AVERAGES]), [score.psnr for score in scores]
    at = numpy.log(seconds)
    first = 0 if at < times[1] else 1
    slope = (psnrs[first + 1] - psnrs[first]) / (times[first + 1] - times[first])
    return float(psnrs[first] + slope * (at - times[first]))


GUIDES_SPP = 2  # samples of renders of albedo and normal that x4 models are measured with


def guided(model, pair):
    """Returns the job with albedo and normal of a render of their own."""
    return dataclasses.replace(fused(model, pair), guides=guides(GUIDES_SPP))


def guided_plan(models):
    rows = [(model.name, [guided(model, pair) for pair in PAIRS[4]]) for model in models if model.scale == 4]
    return Plan("guided", "", [f"{low}-{high}" for low, high in PAIRS[4]], rows)


def rendering_s(job, view):
    """Returns the seconds of rendering a fusion's inputs."""
    return sum(view.seconds_of(file) for file in (job.hrls, job.guides, job.lrhs) if file)


def timed_jobs(models):
    """Yields (label, job) for the table of equal seconds."""
    for method in ("nfor", "oidn"):
        for spp in AVERAGES:
            yield f"{DENOISERS[method]}, {pair_text(0, spp)}", Job(method, hrls=render(spp))
    for model, scale, pair, _ in pairings(models):
        yield label(model, scale, pair), fused(model, pair, scale=scale)
        if model.scale == scale == 4:
            yield f"{label(model, scale, pair)}, guides of {GUIDES_SPP}", guided(model, pair)


def equal_seconds_sheet(models, views, store):
    """Makes the table of leads over the filter when rendering the inputs takes as long as its render."""
    rows = []
    for label, job in timed_jobs(models):
        leads = []
        for view in views:
            own = store.get(job, view)
            seconds = rendering_s(job, view)
            filtered = filtered_psnr(view, store, seconds) if own else None
            leads.append((own.psnr - filtered, seconds) if filtered else None)
        if not leads or not all(leads):
            continue
        psnr, seconds = zip(*leads)
        ahead = f"{sum(p > 0 for p in psnr)} of {len(views)}"
        rows.append([label, f"{statistics.median(seconds):.1f}", ahead, *spread(psnr)])
    return Sheet("equal-seconds", ["", "seconds", "ahead in PSNR", "lead, median dB", "least", "most"], rows)


# RENDERS are the plain renders, RENDERS_SPP their samples a pixel.
RENDERS = [*(Job("render", hrls=render(spp)) for spp in PLAIN), Job("renders")]
RENDERS_SPP = (*PLAIN, ALL_PLAIN)


def equal_spp(errors, target):
    """Returns (samples a pixel at which a plain render's error falls to `target`, whether the last render has fewer).

    They are interpolated between logarithms. Beyond the last render, the error is taken to fall as 1 / N, as its
    variance does.
    """
    errors = numpy.minimum.accumulate(errors)
    if target < errors[-1]:
        return RENDERS_SPP[-1] * errors[-1] / target, True
    return (
        float(numpy.exp(numpy.interp(numpy.log(target), numpy.log(errors[::-1]), numpy.log(RENDERS_SPP[::-1])))),
        False,
    )


def fusing_s(model, views, store):
    """Returns the shortest measured time: all images have one size, and other load on the machine only adds to it."""
    scores = [store.get(fused(model, pair), view) for pair in PAIRS[model.scale] for view in views]
    return min((score.seconds for score in scores if score), default=None)


def equal_time(model, i, view, store, fusing):
    """Returns {spp, beyond, ratio, ratio_fusing} for PSNR and for RelMSE, or None if not all was measured.

    PSNR is compared by its squared error. `fusing` is the time of a fusion in seconds.
    """
    job = fused(model, PAIRS[model.scale][i])
    own, plain = store.get(job, view), [store.get(render, view) for render in RENDERS]
    if not own or not all(plain):
        return None
    inputs_s = rendering_s(job, view)
    result = {"inputs": inputs_s, "fusing": fusing}
    for metric, error in (("PSNR", lambda s: 10 ** (-s.psnr / 10)), ("RelMSE", lambda s: s.relmse)):
        spp, beyond = equal_spp([error(s) for s in plain], error(own))
        plain_s = view.seconds(spp)
        ratios = {"ratio": plain_s / inputs_s, "ratio_fusing": plain_s / (inputs_s + fusing)}
        result[metric] = {"spp": spp, "beyond": beyond} | ratios
    return result


def equal_time_sheets(models, views, store):
    """Returns (sheet of medians, sheet with one row for each view)."""
    head = ["", "inputs, s", "fusing, s"]
    for metric in ("PSNR", "RelMSE"):
        head += [
            f"spp of equal {metric}",
            f"beyond {ALL_PLAIN} spp",
            "its time / inputs",
            "its time / (inputs + fusing)",
        ]
    medians, rows = [], []
    for model in models:
        fusing = fusing_s(model, views, store)
        for i, pair in enumerate(PAIRS[model.scale]):
            results = [equal_time(model, i, view, store, fusing) for view in views]
            if not results or not all(results):
                continue
            label = f"{model.name}, {pair_text(*pair)}"
            rows += [[f"{view.name} {label}", *equal_time_cells([result])] for view, result in zip(views, results)]
            medians.append([label, *equal_time_cells(results)])
    return Sheet("equal-time", head, medians), Sheet("equal-time-views", head, rows)


def equal_time_cells(results):
    median = lambda values: f"{statistics.median(values):.1f}"
    cells = [median([r["inputs"] for r in results]), median([r["fusing"] for r in results])]
    for metric in ("PSNR", "RelMSE"):
        own = [r[metric] for r in results]
        cells += [median([r["spp"] for r in own]), f"{sum(r['beyond'] for r in own)} of {len(own)}"]
        cells += [median([r[key] for r in own]) for key in ("ratio", "ratio_fusing")]
    return cells


def equal_time_plan(models):
    """Plans the plain renders, and the fused images that are compared with them."""
    rows = [("plain render", RENDERS)]
    rows += [(model.name, [fused(model, pair) for pair in PAIRS[model.scale]]) for model in models]
    return Plan("plain", "", [f"{spp} spp" for spp in RENDERS_SPP], rows)


def insert(document, sheets):
    """Replaces the text between `<!-- begin NAME -->` and `<!-- end -->` by the sheet of that name."""
    for one in sheets:
        pattern = rf"(<!-- begin {re.escape(one.name)} -->\n).*?(<!-- end -->)"
        document = re.sub(pattern, lambda m: m[1] + one.markdown() + "\n" + m[2], document, flags=re.DOTALL)
    return document

#!/usr/bin/python3
"""Measures the raymeld program on the test set; writes the tables as CSV and into docs/quality.md.

Earlier measurements are kept, so that after a stop, or with a new model or view, only the missing ones are made. A view
is known by its reference, so that its other renders may be made anew. Remove results.csv after a change to the program
that may change images.
"""

import argparse
import pathlib
import sys

import torch

from evaluation import agreement, cost, pictures, tables, test_set
from evaluation.jobs import Model, Store

ROOT = pathlib.Path(__file__).resolve().parent.parent
TABLES = ("main", "paper", "upscale", "best-lrhs", "decimated", "grid", "ablations", "robustness", "equal-time", "cost")
SHOWN = "x4-balanced"  # the model in the pictures


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", required=True, help="folder of the test set")
    parser.add_argument("--models", type=pathlib.Path, nargs="+", default=sorted(ROOT.glob("models/*.safetensors")))
    parser.add_argument("--ablations", type=pathlib.Path, help="folder of models that were trained without an input")
    parser.add_argument("--program", type=pathlib.Path, default=ROOT / "build/release/raymeld")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "bench/quality")
    only = parser.add_argument_group("only")
    only.add_argument("--tables", nargs="+", choices=TABLES, default=TABLES)
    only.add_argument("--scales", type=int, nargs="+", default=(1, 2, 4, 8), help="1 is HRLS alone")
    only.add_argument("--first", type=int, help="number of views to measure, from the first")
    only.add_argument("--measured", action="store_true", help="write the tables of earlier measurements alone")
    parser.add_argument("--no-check", action="store_true", help="do not compare the program with PyTorch")
    parser.add_argument("--write-docs", action="store_true", help="put the tables into docs/quality.md, with pictures")
    return parser.parse_args()


def models_of(paths, scales):
    models = [Model.load(path) for path in paths]
    return sorted((m for m in models if m.scale in scales), key=lambda m: (m.scale, m.path.stat().st_size))


def measure(plans, views, store):
    jobs = list(dict.fromkeys(job for plan in plans for job in plan.jobs()))
    todo = [(job, view) for job in jobs for view in views if not store.get(job, view)]
    for i, (job, view) in enumerate(todo):
        score = store.measure(job, view)
        what = " ".join(filter(None, (job.model.name if job.model else "", job.lrhs, job.hrls, job.change)))
        print(f"{i + 1}/{len(todo)} {view.name} {job.method} {what}: {tables.text(score)}, {score.seconds:.1f} s")
        sys.stdout.flush()


def check(models, view, program):
    """Prints how far the program is from PyTorch; returns whether all models agree."""
    good = True
    for model in models:
        results = agreement.check(model, view, program)
        good &= agreement.agrees(results)
        for what, (value, limit) in results.items():
            print(f"{model.name}: {what}: {value:.2g}, at most {limit:.2g}{'' if value <= limit else ' EXCEEDED'}")
    return good


def write_docs(sheets, models, views, store):
    docs = ROOT / "docs"
    page = docs / "quality.md"
    page.write_text(tables.insert(page.read_text(), sheets))
    shown = next((model for model in models if model.name == SHOWN), None)
    has_main = any(sheet.name == "main" for sheet in sheets)
    if has_main and shown and all(tables.first_lead(shown, view, store) for view in views):
        print("pictures:", *(view.name for view in pictures.write_worst(shown, views, store, docs)))


def main():
    args = parse()
    torch.set_num_threads(1)
    views = test_set.load(args.views)[: args.first]
    everything = models_of(args.models, args.scales)
    models = [model for model in everything if model.reads_hrls]
    fusing = [model for model in models if model.reads_lrhs]
    ablations = models_of(sorted(args.ablations.glob("*.safetensors")) if args.ablations else [], args.scales)
    store = Store(args.out / "results.csv", args.program)

    plans = {
        "main": [tables.main_plan(models)],
        "paper": [tables.main_plan(models, "paper", test_set.PAPER_PAIRS)],
        "upscale": [tables.upscale_plan([model for model in everything if not model.reads_hrls])],
        "best-lrhs": [tables.best_plan([model for model in everything if model.reads_lrhs])],
        "decimated": [tables.decimated_plan(fusing)],
        "robustness": [tables.robustness_plan(fusing)],
        "ablations": [tables.ablation_plan(fusing, ablations)],
        "equal-time": [tables.equal_time_plan(models), tables.guided_plan(fusing)],
        "grid": [tables.grid_plan(model) for model in models if model.scale == 4],
    }
    plans = [plan for name, group in plans.items() if name in args.tables for plan in group if plan.rows]
    if not args.measured:
        measure(plans, views, store)
    sheets = [tables.sheet(plan, views, store) for plan in plans if plan.name != "plain"]
    if "main" in args.tables:
        sheets += [tables.lead_sheet(name, models, views, store) for name in tables.LEADS]
        sheets += [tables.scenes_sheet(models, views, store)]
    if "equal-time" in args.tables:
        sheets += tables.equal_time_sheets(models, views, store)
        sheets.append(tables.equal_seconds_sheet(models, views, store))
    if "cost" in args.tables and not args.measured:
        sheets.append(cost.sheet(everything, views[0], args.program))
    for sheet in sheets:
        sheet.write_csv(args.out)
        print(f"\n{sheet.name}\n{sheet.markdown()}")
    if args.write_docs:
        write_docs(sheets, models, views, store)
    if not args.no_check and not check([*everything, *ablations], views[0], args.program):
        sys.exit("the program and PyTorch do not agree")


if __name__ == "__main__":
    main()

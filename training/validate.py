#!/usr/bin/python3
"""Measures models on the held-out views with ordinary small renders, beside the SVGF-like filter of a plain render.

validate.py --views PAIRS MODEL.safetensors|checkpoint.pt... prints sRGB PSNR and RelMSE, means over the views, and the
share of views in which a model is ahead of the filter.
"""

import argparse
import pathlib

import torch

import dataset
import loss
import model
from evaluation import filters

# The pairs cost two, four and eight samples a pixel together. At a scale of 1 both counts are those of HRLS.
SPP = {
    1: ((2, 2), (4, 4), (8, 8)),
    2: ((4, 1), (8, 2), (16, 4)),
    4: ((16, 1), (32, 2), (64, 4)),
    8: ((64, 1), (128, 2), (256, 4)),
}

# Samples of HRLS, and the full-size render that LRHS is every s-th pixel of.
DECIMATED = ((1, "0008"), (2, "reference-a"), (4, "reference-a"))


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", required=True, help="folder of packed views")
    parser.add_argument("models", nargs="*", type=pathlib.Path)
    parser.add_argument("--guides", type=int, help="take albedo and normal of HRLS from a render of that many samples")
    parser.add_argument("--decimated", action="store_true", help="take every s-th pixel of full-size renders as LRHS")
    parser.add_argument("--small-scale", type=int, help="take small renders of this scale, twice the model's")
    return parser.parse_args()


def load(path):
    if path.suffix != ".pt":
        return model.load(path)
    saved = torch.load(path, map_location="cpu")
    network = model.create(model.Config(**saved["config"]))
    network.load_state_dict(saved["average"])
    return network


def measured(image, reference):
    """Returns (PSNR, RelMSE)."""
    return loss.psnr(image, reference), loss.relmse(image, reference)


@torch.no_grad()
def score(network, view, counts, blank=lambda lrhs, hrls: (lrhs, hrls), guides=None, decimated=None, small_scale=None):
    """Returns (PSNR, RelMSE) of a whole view.

    `blank` may zero parts of the inputs; the others are those of dataset.pair().
    """
    lrhs, hrls, reference, exposure, spp = dataset.pair(view, network.config, *counts, guides, decimated, small_scale)
    centered = torch.tensor("centered" in network.config.lrhs_sampling and not decimated)
    inputs = (image.to(next(network.parameters()).device) for image in blank(lrhs, hrls))
    fused = model.predict(network, *inputs, centered, exposure, spp)[1].cpu()
    return measured(fused / exposure, reference / exposure)


def filter_score(view, spp):
    """Returns (PSNR, RelMSE) of the SVGF-like filter of a plain render."""
    image = filters.svgf(*view.noisy(spp), filters.TUNED["svgf"][spp])
    return measured(torch.from_numpy(image).permute(2, 0, 1).float()[None], view.reference()[None, :3])


def show(name, scores, rivals):
    """Prints a row; `scores` and `rivals` hold, for each pair of sample counts, the scores of every view."""
    cells = []
    for own, other in zip(scores, rivals):
        psnr, relmse = (sum(column) / len(own) for column in zip(*own))
        ahead = sum(a[0] > b[0] for a, b in zip(own, other)) / len(own)
        cells.append(f"{psnr:.2f} dB / {relmse:.4f} ({ahead:.0%})")
    print("|", name, "|", " | ".join(cells), "|", flush=True)


def main():
    args = parse()
    torch.set_num_threads(1)
    views = dataset.load(args.views)[1]
    print(len(views), "held-out views")
    rivals = [[filter_score(view, spp) for view in views] for spp in (2, 4, 8)]
    show("SVGF-like filter of a plain render", rivals, rivals)

    for path in args.models:
        network = load(path)
        pairs = [
            dict(counts=counts, guides=args.guides, small_scale=args.small_scale)
            for counts in SPP[args.small_scale or network.config.scale]
        ]
        if args.decimated:
            pairs = [dict(counts=(None, spp), guides=args.guides, decimated=render) for spp, render in DECIMATED]
        scores = [[score(network, view, **pair) for view in views] for pair in pairs]
        show(f"{path.parent.name}/{path.stem}", scores, rivals)


if __name__ == "__main__":
    main()

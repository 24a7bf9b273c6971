#!/usr/bin/env python3
"""Writes a model file from a checkpoint, or one with random weights for trying out a shape."""

import argparse
import json

import torch

import model
import safetensors
import stock

LICENSE = "CC-BY-4.0"
ATTRIBUTION = (
    "Trained on renders of models by Andrew Kator & Jennifer Legaz (CC BY 3.0 US), Reallusion (CC BY 3.0 US) and "
    "Blend Swap authors (CC0), from the Sweet Home 3D furniture catalogues"
)


def write(path, name, config, state, provenance, half=False):
    metadata = {"format": "raymeld.model", "format_version": "1", "name": name, "version": "1"}
    metadata |= config.metadata()
    metadata |= {"training": json.dumps(provenance), "license": LICENSE, "attribution": ATTRIBUTION}
    kind = torch.float16 if half else torch.float32
    safetensors.save(path, {key: value.to(kind).numpy() for key, value in state.items()}, metadata)


def untrained_config(shape, choices):
    """Returns the Config of a stock model or of --untrained's numbers, with metadata entries changed."""
    if shape in stock.names():
        return stock.config(shape, choices)
    config = model.Config(*map(int, shape.split(",")))
    return model.Config.parse(config.metadata() | dict(choice.split("=") for choice in choices))


def blended(state, path, share):
    """Mixes `share` of `state` with 1 - `share` of the model it started from; returns the state and its provenance.

    Fine-tuning on few views forgets some of what more views taught (Wortsman et al., Robust fine-tuning, 2022).
    """
    tensors, metadata = safetensors.load(path)
    start = {key: torch.tensor(value).float() for key, value in tensors.items() if key in state}
    for key, value in start.items():
        if value.shape != state[key].shape:
            raise SystemExit(f"{path}: {key} has shape {list(value.shape)}, expected {list(state[key].shape)}")
    state = state | {key: value.lerp(state[key], share) for key, value in start.items()}
    return state, {"blend": {"share": share, "rest": metadata["name"], "training": json.loads(metadata["training"])}}


def parse():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--name", required=True)
    parser.add_argument("--half", action="store_true", help="store the weights as F16")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--checkpoint")
    source.add_argument(
        "--untrained",
        metavar="SHAPE",
        help="a stock model's name, or scale,features,growth,dense_layers,blocks,groups",
    )
    parser.add_argument("--blend", metavar="FILE", help="mix in weights of this model, which --checkpoint began as")
    parser.add_argument("--share", type=float, default=0.7, help="share of the checkpoint's own weights with --blend")
    parser.add_argument(
        "--choice", nargs="*", default=[], metavar="ENTRY=VALUE", help="metadata entries to change with --untrained"
    )
    return parser.parse_args()


def main():
    args = parse()
    if args.checkpoint:
        saved = torch.load(args.checkpoint, map_location="cpu")
        state, provenance = saved["average"], saved["provenance"]
        if args.blend:
            state, more = blended(state, args.blend, args.share)
            provenance |= more
        write(args.out, args.name, model.Config(**saved["config"]), state, provenance, args.half)
        return
    torch.manual_seed(1)
    config = untrained_config(args.untrained, args.choice)
    write(args.out, args.name, config, model.create(config).state_dict(), {"untrained": True}, args.half)


if __name__ == "__main__":
    main()

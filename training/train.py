#!/usr/bin/env python3
"""Trains a fusion network on rendered views; started again with the same --run it goes on where it stopped."""

import argparse
import csv
import dataclasses
import math
import pathlib
import time

import torch

import dataset
import loss
import model


def parse():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--views", required=True, help="folder of rendered views")
    parser.add_argument("--run", required=True, type=pathlib.Path, help="folder for checkpoint.pt and log.csv")
    parser.add_argument("--shape", default="4,24,16,3,2,1", help="scale,features,growth,dense_layers,blocks,groups")
    parser.add_argument("--transfer", choices=("linear", "log"), default="log")
    parser.add_argument("--base", choices=("none", "bilinear"), default="bilinear")
    parser.add_argument("--loss", choices=("l1", "robust"), default="l1")
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--size", type=int, default=96, help="crop of the full-size image, pixels")
    parser.add_argument("--rate", type=float, default=1e-3)
    parser.add_argument("--minutes", type=float, help="end the cosine decay after this much time, whatever --steps says")
    parser.add_argument("--validate-every", type=int, default=500)
    parser.add_argument("--fp32", action="store_true", help="no bfloat16 autocast")
    parser.add_argument("--threads", type=int, default=1)
    return parser.parse_args()


class Run:
    def __init__(self, args):
        self.args, self.step, self.seconds = args, 0, 0.0
        torch.manual_seed(1)
        config = model.Config(*map(int, args.shape.split(",")), transfer=args.transfer, base=args.base)
        self.network = model.Network(config).to(memory_format=torch.channels_last)
        self.average = {k: v.clone() for k, v in self.network.state_dict().items()}
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=args.rate)
        args.run.mkdir(parents=True, exist_ok=True)
        self.checkpoint = args.run / "checkpoint.pt"
        if self.checkpoint.exists():
            saved = torch.load(self.checkpoint)
            self.network.load_state_dict(saved["network"])
            self.optimizer.load_state_dict(saved["optimizer"])
            self.average, self.step, self.seconds = saved["average"], saved["step"], saved["seconds"]

    def save(self, views):
        args = {k: v for k, v in vars(self.args).items() if k not in ("views", "run", "threads")}
        provenance = args | {"steps_done": self.step, "hours": round(self.seconds / 3600, 2), "training_views": views}
        saved = {
            "network": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "average": self.average,
            "step": self.step,
            "seconds": self.seconds,
            "config": dataclasses.asdict(self.network.config),
            "provenance": provenance,
        }
        partial = self.checkpoint.with_suffix(".part")
        torch.save(saved, partial)
        partial.rename(self.checkpoint)

    def progress(self):
        if self.args.minutes:
            return min(1.0, self.seconds / 60 / self.args.minutes)
        return min(1.0, self.step / self.args.steps)

    def train_step(self, views):
        args, config = self.args, self.network.config
        rate = args.rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * self.progress())))
        for group in self.optimizer.param_groups:
            group["lr"] = rate * min(1, (self.step + 1) / 200)
        lrhs, hrls, reference = dataset.batch(views, config.scale, args.size, args.batch, self.step)
        with torch.autocast("cpu", torch.bfloat16, enabled=not args.fp32):
            encoded, linear = model.predict(self.network, lrhs, hrls.contiguous(memory_format=torch.channels_last))
        if args.loss == "l1":
            error = loss.l1(encoded.float(), model.encode_layer(reference, "color", config))
        else:
            error = loss.robust(linear.float(), reference.clamp(0, config.clip))
        self.optimizer.zero_grad(set_to_none=True)
        error.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self.optimizer.step()
        self.step += 1
        keep = min(0.998, self.step / (self.step + 10))
        for key, value in self.network.state_dict().items():
            self.average[key].lerp_(value, 1 - keep)
        return float(error.detach())

    @torch.no_grad()
    def validate(self, views):
        """Mean (PSNR, RelMSE) of the averaged weights over whole views at 16 and 1 spp, fp32."""
        network = model.Network(self.network.config)
        network.load_state_dict(self.average)
        scores = []
        for view in views:
            lrhs, hrls, reference = dataset.pair(view, self.network.config.scale)
            fused = model.predict(network, lrhs, hrls)[1]
            scores.append((loss.psnr(fused, reference), loss.relmse(fused, reference)))
        return [sum(column) / len(scores) for column in zip(*scores)]

    def log(self, error, psnr, relmse):
        path = self.args.run / "log.csv"
        fresh = not path.exists()
        with open(path, "a", newline="") as file:
            writer = csv.writer(file)
            if fresh:
                writer.writerow(("step", "minutes", "loss", "psnr", "relmse"))
            row = (self.step, f"{self.seconds / 60:.1f}", f"{error:.5f}", f"{psnr:.3f}", f"{relmse:.5f}")
            writer.writerow(row)
        print(*row, flush=True)


def main():
    args = parse()
    torch.set_num_threads(args.threads)
    run = Run(args)
    training, held_out = dataset.load(args.views)
    print(len(training), "training views,", len(held_out), "held out", flush=True)
    error, mean_error = 0.0, 0.0
    while run.progress() < 1:
        start = time.monotonic()
        error = run.train_step(training)
        mean_error = error if not mean_error else 0.99 * mean_error + 0.01 * error
        run.seconds += time.monotonic() - start
        if run.step % args.validate_every == 0 or run.progress() >= 1:
            run.log(mean_error, *run.validate(held_out))
            run.save(len(training))


main()

#!/usr/bin/env python3
"""Trains a fusion network on rendered views; started again with the same --run it goes on where it stopped."""

import argparse
import csv
import dataclasses
import datetime
import json
import math
import pathlib
import tempfile
import time

import torch
import torch.distributed
import torch.multiprocessing

import dataset
import grow
import loss
import model
import safetensors
import stock
import validate

LOGGED = ("step", "minutes", "loss", "psnr", "relmse", "psnr_2", "relmse_2", "psnr_4", "relmse_4", "views", "held_out")
ENCODED_LOSSES = {"rms": loss.rms, "l1": loss.l1}
WITHOUT = ("none", "hrls", "lrhs", "layers")


def fast_precision():
    """Returns bf16 if the processor multiplies bfloat16, else fp32; PyTorch emulates it at a tenth of the speed."""
    return "bf16" if "avx512_bf16" in pathlib.Path("/proc/cpuinfo").read_text() else "fp32"


def parse():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--views", required=True, help="folder of packed views, by scenes/pairs.py")
    parser.add_argument("--run", required=True, type=pathlib.Path, help="folder for checkpoint.pt and log.csv")
    parser.add_argument("--model", required=True, choices=stock.names(), help="which stock model")
    parser.add_argument(
        "--choice", nargs="*", default=[], metavar="ENTRY=VALUE", help="metadata entries unlike the stock model's"
    )
    parser.add_argument("--without", choices=WITHOUT, default="none", help="ablation: blank an input, or all but RGB")
    parser.add_argument("--init", help="start from a narrower pyramid, one of another scale, or fitting tensors")
    parser.add_argument("--loss", choices=(*ENCODED_LOSSES, "robust"), default="rms")
    parser.add_argument("--beta", type=float, default=0.1, help="beta of the robust loss")
    parser.add_argument("--minutes", type=float, required=True, help="training time and length of the cosine decay")
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--size", type=int, default=96, help="crop of the full-size image, pixels")
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--validate-every", type=float, default=3, help="minutes of training between validations")
    parser.add_argument(
        "--precision", choices=("fp32", "bf16"), help="by default bf16 on a GPU, and where the processor has it"
    )
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--processes", type=int, default=1, help="each takes a batch; their gradients are averaged")
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--constant", action="store_true", help="keep the rate, so that training may go on")
    args = parser.parse_args()
    if args.processes > 1 and args.device != "cpu":
        parser.error("--processes: a GPU takes one")
    args.precision = args.precision or (fast_precision() if args.device == "cpu" else "bf16")
    return args


class Run:
    def __init__(self, args, rank=0):
        self.args, self.rank, self.step, self.seconds = args, rank, 0, 0.0
        self.device = torch.device(args.device)
        self.counted = None  # clock() at the last step
        self.views = {}  # by their paths, so that a device holds each once
        torch.manual_seed(1)
        self.config = stock.config(args.model, args.choice)
        if args.without == "lrhs":
            self.config.lrhs_certainty = 0.0
        self.network = model.create(self.config).to(self.device, memory_format=torch.channels_last)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=args.rate)
        args.run.mkdir(parents=True, exist_ok=True)
        self.checkpoint = args.run / "checkpoint.pt"
        self.earlier = self.start_from(args.init) if args.init else {}
        self.average = {key: value.clone() for key, value in self.network.state_dict().items()}
        if self.checkpoint.exists():
            saved = torch.load(self.checkpoint, map_location=self.device)
            self.network.load_state_dict(saved["network"])
            self.optimizer.load_state_dict(saved["optimizer"])
            self.average, self.step, self.seconds = saved["average"], saved["step"], saved["seconds"]

    def start_from(self, path):
        """Starts as another model, as far as grow.py can, or with its fitting tensors; returns how it was trained."""
        tensors, metadata = safetensors.load(path)
        tensors = {key: torch.tensor(value).float() for key, value in tensors.items()}
        own = {key: value.cpu() for key, value in self.network.state_dict().items()}
        small = model.Config.parse(metadata)
        if small.network != self.config.network:
            raise SystemExit(f"{path}: its network is a {small.network}, expected a {self.config.network}")
        if grow.is_narrower(small, self.config):
            same = grow.widened(tensors, small, self.config, own)
        elif grow.differs_in_lrhs_alone(small, self.config):
            same = grow.rejoined(tensors, small, self.config, own)
        else:
            same = {key: value for key, value in tensors.items() if key in own and own[key].shape == value.shape}
        self.network.load_state_dict(own | same)
        return {"started_from": {"name": metadata["name"], "training": json.loads(metadata["training"])}}

    def clock(self):
        """Returns seconds of processor time of each thread, or of the wall where a GPU works."""
        return time.process_time() / self.args.threads if self.device.type == "cpu" else time.monotonic()

    def load(self):
        """Returns the (training views, validation views) that have what the network reads."""
        parts = (dataset.trainable(views, self.config) for views in dataset.load(self.args.views))
        training, held_out = ([self.views.setdefault(view.path, view) for view in part] for part in parts)
        if not training:
            raise SystemExit(f"{self.args.views}: no view has small renders for x{self.config.scale}")
        if self.device.type != "cpu":
            for view in training:
                view.hold(self.device)
        return training, held_out

    def batches(self, views):
        """Returns an iterator of batches, from the next step's on."""
        seeds = range(self.step * self.args.processes + self.rank, 2**62, self.args.processes)
        return (dataset.batch(views, self.config, self.args.size, self.args.batch, seed) for seed in seeds)

    def save(self, views):
        unsaid = ("views", "run", "threads", "init", "device")
        args = {key: value for key, value in vars(self.args).items() if key not in unsaid}
        provenance = args | {"steps": self.step, "hours": round(self.seconds / 3600, 2), "training_views": views}
        provenance |= self.earlier
        saved = {
            "network": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "average": self.average,
            "step": self.step,
            "seconds": self.seconds,
            "config": dataclasses.asdict(self.config),
            "provenance": provenance,
        }
        partial = self.checkpoint.with_suffix(".part")
        torch.save(saved, partial)
        partial.rename(self.checkpoint)

    def progress(self):
        return min(1.0, self.seconds / 60 / self.args.minutes)

    def inputs(self, lrhs, hrls):
        """Replaces the inputs that the network is trained without by zeros."""
        if self.args.without == "lrhs":
            lrhs = torch.zeros_like(lrhs)
        if self.args.without == "hrls":
            hrls = torch.zeros_like(hrls)
        if self.args.without == "layers":
            kept = torch.tensor([name not in self.config.optional_layers for name in self.config.hrls_layers])
            hrls = hrls * kept.repeat_interleave(3)[:, None, None].to(hrls.device)
        return lrhs, hrls

    def error(self, encoded, reference):
        """Computes the chosen loss of the network's own output, to which radiance above the clip is not yet added."""
        if self.args.loss == "robust":
            linear = model.decode(encoded, self.config.transfer)
            return loss.robust(linear, reference.clamp(0, self.config.clip), self.args.beta)
        return ENCODED_LOSSES[self.args.loss](encoded, model.encode_layer(reference, "color", self.config))

    def train_step(self, batch):
        args = self.args
        decay = 1 if args.constant else 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * self.progress()))
        for group in self.optimizer.param_groups:
            group["lr"] = args.rate * decay * min(1, (self.step + 1) / 200)
        lrhs, hrls, reference, centered, spp = batch
        with torch.autocast(self.device.type, torch.bfloat16, enabled=args.precision == "bf16"):
            encoded = model.predict(self.network, *self.inputs(lrhs, hrls), centered, spp=spp)[0]
        error = self.error(encoded.float(), reference)
        self.optimizer.zero_grad(set_to_none=True)
        error.backward()
        # What a step takes after this is counted in the next one, so that all processes count the same.
        error = float(error.detach())  # waits for a GPU
        now = self.clock()
        error, seconds = self.mean_of_processes(error, now - self.counted)
        self.seconds, self.counted = self.seconds + seconds, now
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self.optimizer.step()
        self.step += 1
        keep = min(0.998, self.step / (self.step + 10))
        for key, value in self.network.state_dict().items():
            self.average[key].lerp_(value, 1 - keep)
        return error

    def mean_of_processes(self, *numbers):
        """Averages all gradients and these numbers over the processes, and returns the numbers."""
        if self.args.processes == 1:
            return numbers
        gradients = [value.grad for value in self.network.parameters()]
        flat = torch.cat([*(gradient.flatten() for gradient in gradients), torch.tensor(numbers)])
        torch.distributed.all_reduce(flat)
        flat /= self.args.processes
        *parts, numbers = flat.split([*(gradient.numel() for gradient in gradients), len(numbers)])
        for gradient, part in zip(gradients, parts):
            gradient.copy_(part.view_as(gradient))
        return numbers.tolist()

    def validate(self, views):
        """Returns PSNR and RelMSE at each of validate.SPP in turn: averaged weights, means over whole views, fp32."""
        network = model.create(self.config).to(self.device)
        network.load_state_dict(self.average)
        means = []
        for counts in validate.SPP[self.config.scale]:
            scores = [validate.score(network, view, counts, self.inputs) for view in views]
            means += [sum(column) / len(scores) for column in zip(*scores)]
        return means

    def log(self, error, views, held_out):
        """Validates and appends a row to log.csv; `views` is the number of training views."""
        path = self.args.run / "log.csv"
        fresh = not path.exists()
        with open(path, "a", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            if fresh:
                writer.writerow(LOGGED)
            scores = [
                f"{score:.3f}" if i % 2 == 0 else f"{score:.5f}" for i, score in enumerate(self.validate(held_out))
            ]
            row = (self.step, f"{self.seconds / 60:.1f}", f"{error:.5f}", *scores, views, len(held_out))
            writer.writerow(row)
        print(*row, flush=True)


def work(rank, args, meeting):
    """Trains; each process does the same, and that of rank 0 validates and saves."""
    torch.set_num_threads(args.threads)
    if args.processes > 1:
        torch.distributed.init_process_group(
            "gloo", f"file://{meeting}", datetime.timedelta(days=1), args.processes, rank
        )
    run = Run(args, rank)
    training, held_out = run.load()
    batches, run.counted = run.batches(training), run.clock()
    mean_error, next_validation = 0.0, run.seconds + 60 * args.validate_every
    while run.progress() < 1:
        error = run.train_step(next(batches))
        mean_error = error if not mean_error else 0.99 * mean_error + 0.01 * error
        if run.seconds >= next_validation or run.progress() >= 1:
            next_validation = run.seconds + 60 * args.validate_every
            if rank == 0:
                run.log(mean_error, len(training), held_out)
                run.save(len(training))
            training, held_out = run.load()  # more views may have been rendered
            batches, run.counted = run.batches(training), run.clock()  # validation does not count


def main():
    args = parse()
    with tempfile.TemporaryDirectory() as folder:
        meeting = pathlib.Path(folder) / "meeting"
        if args.processes == 1:
            work(0, args, meeting)
        else:
            torch.multiprocessing.spawn(work, (args, meeting), args.processes)


if __name__ == "__main__":
    main()

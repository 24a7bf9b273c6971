"""Measures raymeld beside PyTorch and oneDNN and writes bench/results/NAME.csv and, if asked to, docs/performance.md.

All programs are children of this process, pinned to one core, with one thread each. They take turns: a round measures
every frame with every program once, so that other work of the machine hits all alike. Figures are medians of the
rounds. The device's peak is measured beside every frame of every round, with the same driver.
"""

import argparse
import collections
import csv
import json
import os
import pathlib
import shutil
import statistics
import struct
import subprocess
import sys
import tempfile

import numpy

ROOT = pathlib.Path(__file__).parent.parent
BENCH, PROGRAM = ROOT / "build/release/bench/raymeld_bench", ROOT / "build/release/raymeld"
# These have the shapes of their papers, untrained: a shape of export.py, or a stock model and what changes.
PAPERS = {
    **{f"x{scale}-full": (f"{scale},64,64,4,5,3",) for scale in (2, 4)},  # Hou et al. 2021
    "x4-edsr-full": ("x4-edsr", "features=256", "blocks=32"),  # Lim et al. 2017
    "x4-rcan-full": ("x4-rcan", "features=64", "groups=10", "blocks=20"),  # Zhang et al. 2018
    "denoise-kpcn-full": ("denoise-kpcn", "features=100", "depth=9", "kernel_side=21"),  # Bako et al. 2017
}

FRAMES = ["x4-fast 256x256", "x4-fast 512x512", "x4-fast 1024x1024", "x4-fast 1920x1080", "x4-balanced 256x256",
          "x4-balanced 512x512", "x4-full 256x256", "x4-full 512x512", "x4-full 1024x1024", "x2-fast 512x512",
          "x2-balanced 512x512", "x2-full 256x256", "denoise-balanced 512x512", "x4-edsr 512x512", "x4-rcan 512x512",
          "x4-edsr-full 256x256", "x4-rcan-full 256x256", "denoise-kpcn-full 256x256"]


def metadata(path):
    """Returns the metadata of a safetensors file."""
    with open(path, "rb") as file:
        size = struct.unpack("<Q", file.read(8))[0]
        return json.loads(file.read(size))["__metadata__"]


Result = collections.namedtuple("Result", "kind name program metric value")


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--name", default="here", help="name of the results")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--core", type=int, default=os.cpu_count() - 1, help="CPU core to pin the programs to")
    parser.add_argument("--frames", nargs="+", default=FRAMES, metavar="'MODEL WxH'",
                        help="frames to measure; a model named full has its paper's shape, untrained")
    parser.add_argument("--beside", type=pathlib.Path, metavar="FOLDER",
                        help="folder of scripts/unpack whose Vulkan driver is measured as well, with fp32 frames")
    parser.add_argument("--no-tune", action="store_true", help="keep the default kernels, or those tuned before")
    parser.add_argument("--no-pytorch", action="store_true")
    parser.add_argument("--layers", default="conv2d", help="regular expression of raymeld_bench's layers to measure")
    parser.add_argument("--write-docs", action="store_true")
    return parser.parse_args()


class Bench:
    def __init__(self, args, folder):
        self.args, self.folder, self.results = args, folder, []
        self.on_cpu = True
        self.environment = os.environ | {
            "OMP_NUM_THREADS": "1",
            "LP_NUM_THREADS": "0",  # Mesa's driver for CPUs then works in the one thread that submits
            "XDG_CACHE_HOME": str(folder / "cache"),
            "MESA_SHADER_CACHE_DIR": str(folder / "mesa"),
        }

    def run(self, *command, **environment):
        pinned = ["taskset", "-c", str(self.args.core), *map(str, command)]
        done = subprocess.run(pinned, env=self.environment | environment, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{' '.join(pinned)}: {done.stderr or done.stdout}")
        return done.stdout

    def add(self, *fields):
        self.results.append(Result(*fields))

    def benchmarks(self, pattern, *options, runner=(), **environment):
        text = self.run(*runner, BENCH, f"--benchmark_filter={pattern}", "--benchmark_format=json", *options,
                        **environment)
        return json.loads(text)

    def model_file(self, name):
        stock = ROOT / f"models/{name}.safetensors"
        if stock.exists():
            return stock
        path = self.folder / f"{name}.safetensors"
        if not path.exists():
            shape, *changes = PAPERS[name]
            self.run(sys.executable, ROOT / "training/export.py", "--untrained", shape, "--choice", *changes,
                     "--name", name, "--out", path)
        return path

    def tune(self, frames):
        for model, size in {model: size for model, size in frames}.items():  # each model's last size
            for precision in ("fp32",) if self.on_cpu else ("fp32", "fp16"):
                print("tuning", model, size, precision, flush=True)
                tune = (PROGRAM, "tune", "--precision", precision, "--model", self.model_file(model), "--size", size)
                self.run(*tune)
                if self.args.beside:
                    self.run(*self.beside(), *tune)

    def beside(self):
        return (self.args.beside / "run",) if self.args.beside else ()

    def cold_caches(self):
        """Returns an environment whose caches are empty but for what was tuned."""
        folder = pathlib.Path(tempfile.mkdtemp(dir=self.folder))
        (folder / "raymeld").mkdir()
        for file in (self.folder / "cache/raymeld").glob("tuning-*.json"):
            shutil.copy(file, folder / "raymeld")
        return {"XDG_CACHE_HOME": str(folder), "MESA_SHADER_CACHE_DIR": str(folder / "mesa")}

    def layers(self):
        repeated = (f"--benchmark_repetitions={self.args.rounds}", "--benchmark_enable_random_interleaving=true",
                    "--benchmark_min_time=0.1")
        for entry in self.benchmarks(f"peak|{self.args.layers}", *repeated)["benchmarks"]:
            if entry["run_type"] != "iteration" or "error_message" in entry:
                continue
            parts = entry["run_name"].split("/manual_time")[0].split("/")
            name, program = ("peak", "raymeld") if parts == ["peak"] else ("/".join(parts[1:4]), " ".join(parts[4:]))
            self.add("layer", name, program, "time_ms", entry["real_time"])
            self.add("layer", name, program, "gflop_per_s", entry["FLOP/s"] * 1e-9)

    def frame_inputs(self, model, size):
        folder = self.folder / f"{model}-{size}"
        if not folder.exists():
            folder.mkdir()
            width, height = map(int, size.split("x"))
            entries = metadata(self.model_file(model))
            scale, layers = int(entries["scale"]), len(entries.get("hrls_layers", "color").split(","))
            generator = numpy.random.default_rng(1)
            smooth = numpy.linspace(0.2, 1.0, width, dtype=numpy.float32)
            hrls = smooth * generator.random((3 * layers, height, width), dtype=numpy.float32)
            hrls.tofile(folder / "hrls.raw")
            numpy.ascontiguousarray(hrls[:3, ::scale, ::scale]).tofile(folder / "lrhs.raw")
        return folder

    def raymeld_frame(self, model, size, precision, runner=(), **environment):
        folder = self.frame_inputs(model, size)
        done = self.benchmarks(
            f"^frame/{model}/{size}/{precision}/", "--benchmark_min_time=2",
            RAYMELD_BENCH_MODELS=str(self.model_file(model)), RAYMELD_BENCH_SIZES=size,
            RAYMELD_BENCH_FRAME=str(folder), runner=runner, **environment)
        return done["benchmarks"][0]

    def frame(self, model, size, round_number):
        name, folder = f"{model} {size}", self.frame_inputs(model, size)
        peak = self.benchmarks("^peak")["benchmarks"][0]["FLOP/s"]
        self.add("frame", name, "peak", "gflop_per_s", peak * 1e-9)
        for precision in ("fp32", "fp16"):
            if round_number == 0 and precision == "fp32":
                cold = self.raymeld_frame(model, size, precision, **self.cold_caches())
                self.add("frame", name, "raymeld fp32", "cold_start_s", cold["first_s"] - cold["real_time"] * 1e-3)
            entry = self.raymeld_frame(model, size, precision)
            program = f"raymeld {precision}"
            self.add("frame", name, program, "time_ms", entry["real_time"])
            self.add("frame", name, program, "gflop_per_s", entry["FLOP/s"] * 1e-9)
            self.add("frame", name, program, "share_of_peak", entry["FLOP/s"] / peak)
            if round_number > 0:  # the round before filled the caches
                self.add("frame", name, program, "warm_start_s", entry["first_s"] - entry["real_time"] * 1e-3)
            for metric in ("host_share", "device_bytes", "rss_bytes", "tiles"):
                self.add("frame", name, program, metric, entry[metric])
            (folder / "fused.raw").replace(folder / f"{precision}.raw")
        if self.args.beside:
            peak = self.benchmarks("^peak", runner=self.beside())["benchmarks"][0]["FLOP/s"]
            entry = self.raymeld_frame(model, size, "fp32", runner=self.beside())
            self.add("frame", name, "beside", "time_ms", entry["real_time"])
            self.add("frame", name, "beside", "share_of_peak", entry["FLOP/s"] / peak)
            (folder / "fused.raw").replace(folder / "beside.raw")
        if self.args.no_pytorch:
            return
        for precision in ("fp32", "bf16") if self.on_cpu else ("fp32", "fp16"):
            said = self.run(sys.executable, ROOT / "bench/pytorch_frame.py", self.model_file(model), size, precision,
                            folder)
            self.add("frame", name, f"PyTorch {precision}", "time_ms", json.loads(said)["time_s"] * 1e3)
            if precision == "fp32" and round_number == 0:
                expected = numpy.fromfile(folder / "pytorch.raw", dtype=numpy.float32)
                for own, program in (("fp32", "raymeld fp32"), ("fp16", "raymeld fp16"), ("beside", "beside")):
                    if own == "beside" and not self.args.beside:
                        continue
                    off = numpy.abs(numpy.fromfile(folder / f"{own}.raw", dtype=numpy.float32) - expected)
                    self.add("frame", name, program, "largest_error", float((off / (1 + expected)).max()))


def medians(results):
    """Returns the median of each figure, in the order in which figures were first measured."""
    values = collections.defaultdict(list)
    for result in results:
        values[result[:4]].append(result.value)
    return [Result(*key, statistics.median(all_of_it)) for key, all_of_it in values.items()]


def current_commit():
    """Returns the short name of the commit that is checked out."""
    command = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def main():
    args = parse()
    frames = [tuple(frame.split()) for frame in args.frames]
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(args, pathlib.Path(folder))
        device = bench.benchmarks("^peak")["context"]
        beside = bench.benchmarks("^peak", runner=bench.beside())["context"] if args.beside else {"driver": ""}
        listed = json.loads(bench.run(PROGRAM, "devices", "--json"))["devices"]
        bench.on_cpu = any(d["name"] == device["device"] and d["type"] == "CPU" for d in listed)
        if not args.no_tune:
            bench.tune(frames)
        print("layers", flush=True)
        bench.layers()
        for round_number in range(args.rounds):
            for model, size in frames:
                print(f"round {round_number + 1}: {model} {size}", flush=True)
                bench.frame(model, size, round_number)
            facts = {"name": device["device"], "driver": device["driver"], "beside": beside["driver"],
                     "type": "CPU" if bench.on_cpu else "GPU", "commit": current_commit(),
                     "tuned": "no" if args.no_tune else "yes", "rounds": round_number + 1}
            target = write(args.name, [Result("device", "device", "", *fact) for fact in facts.items()]
                           + medians(bench.results))
    if args.write_docs:
        import report  # needs matplotlib

        report.write(target, ROOT / "docs")


def write(name, results):
    target = ROOT / f"bench/results/{name}.csv"
    target.parent.mkdir(exist_ok=True)
    with target.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Result._fields)
        writer.writerows(r._replace(value=f"{r.value:.6g}" if isinstance(r.value, float) else r.value) for r in results)
    print("wrote", target.relative_to(ROOT), flush=True)
    return target


if __name__ == "__main__":
    main()

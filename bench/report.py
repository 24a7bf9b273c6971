"""Turns bench/results/NAME.csv into docs/performance.md and its plots."""

import collections
import csv

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

COLOURS = {"raymeld fp32": "#c0392b", "raymeld fp16": "#e59866", "PyTorch fp32": "#2471a3", "PyTorch bf16": "#85c1e9"}


class Results:
    def __init__(self, path):
        self.values = {}
        with open(path, newline="") as file:
            for row in csv.DictReader(file):
                self.values[row["kind"], row["name"], row["program"], row["metric"]] = row["value"]

    def get(self, kind, name, program, metric):
        value = self.values.get((kind, name, program, metric))
        return None if value is None else float(value)

    def names(self, kind):
        return list(dict.fromkeys(key[1] for key in self.values if key[0] == kind))

    def programs(self, kind, name):
        return list(dict.fromkeys(key[2] for key in self.values if key[:2] == (kind, name)))


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def number(value, form="{:.1f}"):
    return "" if value is None else form.format(value)


def least_bytes(name, program):
    """Returns the bytes of all operands of a convolution, whose name is KERNELxKERNEL/HEIGHTxWIDTH/IN-OUT."""
    kernel, size, channels = name.split("/")
    height, width = map(int, size.split("x"))
    inputs, outputs = map(int, channels.split("-"))
    element = 2 if "fp16" in program or "bf16" in program else 4
    return element * (height * width * (inputs + outputs) + inputs * outputs * int(kernel[0]) ** 2)


def layer_rows(results):
    peak = results.get("layer", "peak", "raymeld", "gflop_per_s")
    rows = []
    for name in sorted(results.names("layer")):
        if name == "peak":
            continue
        for program in sorted(results.programs("layer", name)):
            rate = results.get("layer", name, program, "gflop_per_s")
            time_ms = results.get("layer", name, program, "time_ms")
            rows.append([name.replace("/", " "), program, number(time_ms, "{:.2f}"), number(rate),
                         number(100 * rate / peak, "{:.0f} %"),
                         number(least_bytes(name, program) / time_ms * 1e-6, "{:.2f}")])
    return rows


def frame_rows(results):
    rows = []
    for name in results.names("frame"):
        get = lambda program, metric, name=name: results.get("frame", name, program, metric)
        pytorch, own = get("PyTorch fp32", "time_ms"), get("raymeld fp32", "time_ms")
        rows.append([name, number(own), number(get("raymeld fp32", "gflop_per_s")),
                     number(100 * get("raymeld fp32", "share_of_peak"), "{:.0f} %"),
                     number(get("raymeld fp16", "time_ms")), number(pytorch), number(get("PyTorch bf16", "time_ms")),
                     number(own / pytorch if pytorch else None, "{:.2f}"),
                     number(get("raymeld fp32", "largest_error"), "{:.1e}"),
                     number(get("raymeld fp16", "largest_error"), "{:.1e}")])
    return rows


def beside_rows(results):
    rows = []
    for name in results.names("frame"):
        get = lambda program, metric, name=name: results.get("frame", name, program, metric)
        time, own, pytorch = get("beside", "time_ms"), get("raymeld fp32", "time_ms"), get("PyTorch fp32", "time_ms")
        if time is not None:
            rows.append([name, number(time), number(100 * get("beside", "share_of_peak"), "{:.0f} %"),
                         number(time / own, "{:.2f}"), number(time / pytorch if pytorch else None, "{:.2f}"),
                         number(get("beside", "largest_error"), "{:.1e}")])
    return rows


def memory_rows(results):
    rows = []
    for name in results.names("frame"):
        get = lambda program, metric, name=name: results.get("frame", name, program, metric)
        rows.append([name, number(get("raymeld fp32", "device_bytes") / 2**20, "{:.0f}"),
                     number(get("raymeld fp16", "device_bytes") / 2**20, "{:.0f}"),
                     number(get("raymeld fp32", "rss_bytes") / 2**20, "{:.0f}"),
                     number(get("raymeld fp32", "cold_start_s"), "{:.2f}"),
                     number(get("raymeld fp32", "warm_start_s"), "{:.2f}"),
                     number(100 * get("raymeld fp32", "host_share"), "{:.2f} %")])
    return rows


def plot_layers(results, path):
    names = sorted(name for name in results.names("layer") if name != "peak")
    peak = results.get("layer", "peak", "raymeld", "gflop_per_s")
    kinds = collections.OrderedDict()
    for name in names:
        for program in results.programs("layer", name):
            if "bf16" not in program and "fp16" not in program:
                kinds.setdefault(program, None)
    figure, axes = plt.subplots(figsize=(9, 0.9 * len(names) + 1))
    height = 0.8 / len(kinds)
    for i, kind in enumerate(kinds):
        shares = [100 * (results.get("layer", name, kind, "gflop_per_s") or 0) / peak for name in names]
        axes.barh([y + i * height for y in range(len(names))], shares, height, label=kind)
    axes.set_yticks([y + 0.4 for y in range(len(names))], [name.replace("/", " ") for name in names])
    axes.axvline(100, color="black", linewidth=0.8)
    axes.invert_yaxis()
    axes.set_xlabel("effective share of the driver's multiply-add peak, %")
    axes.legend()
    figure.tight_layout()
    figure.savefig(path)


def plot_growth(results, path):
    """Plots time and memory against pixels, for the models that were measured at several sizes."""
    by_model = collections.defaultdict(list)
    for name in results.names("frame"):
        model, size = name.split()
        width, height = map(int, size.split("x"))
        by_model[model].append((width * height / 1e6, name))
    figure, (times, memory) = plt.subplots(1, 2, figsize=(10, 4))
    for model, frames in by_model.items():
        if len(frames) < 2:
            continue
        frames.sort()
        pixels = [x for x, _ in frames]
        times.plot(pixels, [results.get("frame", n, "raymeld fp32", "time_ms") for _, n in frames], "o-", label=model)
        if all(results.get("frame", n, "PyTorch fp32", "time_ms") for _, n in frames):
            times.plot(pixels, [results.get("frame", n, "PyTorch fp32", "time_ms") for _, n in frames], "x:",
                       color=times.lines[-1].get_color(), label=f"{model}, PyTorch fp32")
        memory.plot(pixels, [results.get("frame", n, "raymeld fp32", "device_bytes") / 2**20 for _, n in frames], "o-",
                    label=model)
    for axes, label in ((times, "ms a frame"), (memory, "MiB on the device")):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("megapixels")
        axes.set_ylabel(label)
        axes.grid(True, which="both", alpha=0.3)
    times.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path)


def plot_frames(results, path):
    names = results.names("frame")
    figure, axes = plt.subplots(figsize=(9, 0.5 * len(names) + 1))
    height = 0.8 / len(COLOURS)
    for i, (program, colour) in enumerate(COLOURS.items()):
        times = [results.get("frame", name, program, "time_ms") or 0 for name in names]
        axes.barh([y + i * height for y in range(len(names))], times, height, label=program, color=colour)
    axes.set_yticks([y + 0.4 for y in range(len(names))], names)
    axes.set_xscale("log")
    axes.invert_yaxis()
    axes.set_xlabel("ms a frame")
    axes.legend()
    figure.tight_layout()
    figure.savefig(path)


TEXT = """# Performance

`scripts/bench --name {name} --write-docs{options}` measured all of this in one go
at commit {commit}, and wrote this page from `bench/results/{name}.csv`. The device is
{device}, {driver}.{threads}

Every figure is the median of {rounds} rounds in which all programs took turns. GFLOP/s count the
multiplications and additions of direct convolutions. Winograd convolutions (F(2, 3) and F(4, 3), Lavin and
Gray 2016) need fewer, so they may pass 100 % of the peak. The peak is what a shader of this driver reaches
with multiply-adds in registers, here {peak:.0f} GFLOP/s. Absolute times are those of a shared machine; the
ratios are what counts.
[performance-notes.md](performance-notes.md) says what limits these times, and what was measured later.

## Whole frames

Models named *full* have the shapes of their papers, untrained: xN-full that of Hou et al. 2021 (C = R = 64,
D = 4, B = 5, G = 3), x4-edsr-full of Lim et al. 2017, x4-rcan-full of Zhang et al. 2018 and denoise-kpcn-full
of Bako et al. 2017. The others are stock models. PyTorch runs the same weights on the same inputs, channels
last. *Error* is the largest difference from PyTorch's fp32 output, divided by 1 + output.

{frames}
{beside}![Time of whole frames](performance-frames.svg)

![Time and memory against pixels](performance-growth.svg)

## Memory, start, host

- *MiB* is the memory that raymeld allocates on the device, including weights and the images on their way in
  and out. *RSS* is the memory of the whole process on a CPU driver, including its inputs and the compiler.
- *Start* is the time from the model's file to the first frame, without the frame itself: *cold* with empty
  caches, when the driver compiles, and *warm* with filled ones.
- *Host* is the share of a frame in which the host does not wait for the device.

{memory}
## Single convolutions

A convolution is named by its kernel size, height x width, and input and output channels. *Direct* is the
portable kernel. The others run with {kernels}. GB/s count every operand once.{onednn}

{layers}
![Single convolutions](performance-layers.svg)
"""


ONEDNN = " oneDNN runs\nin the memory format it likes best, in fp32 unless stated."


def write(csv_path, docs):
    results = Results(csv_path)
    plot_layers(results, docs / "performance-layers.svg")
    plot_growth(results, docs / "performance-growth.svg")
    plot_frames(results, docs / "performance-frames.svg")
    frames = table(["frame", "fp32, ms", "GFLOP/s", "of the peak", "fp16, ms", "PyTorch fp32, ms", "bf16, ms",
                    "raymeld / PyTorch, fp32", "error fp32", "fp16"], frame_rows(results))
    beside = ""
    if beside_rows(results):
        head = ["frame", "fp32, ms", "of its own peak", "to the driver above", "to PyTorch fp32", "error"]
        beside = (f"The same frames in the same rounds with {results.values['device', 'device', '', 'beside']}:\n\n"
                  + table(head, beside_rows(results)) + "\n")
    memory = table(["frame", "fp32, MiB", "fp16, MiB", "RSS fp32, MiB", "cold start, s", "warm start, s", "host"],
                   memory_rows(results))
    layers = table(["convolution", "by", "ms", "GFLOP/s", "of the peak", "GB/s"], layer_rows(results))
    device = {key[3]: value for key, value in results.values.items() if key[0] == "device"}
    options = (" --beside build/sid" if beside else "") + (" --no-tune" if device["tuned"] == "no" else "")
    kernels = "the default kernels" if device["tuned"] == "no" else "what `raymeld tune` found"
    text = TEXT.format(name=csv_path.stem, commit=device["commit"], device=device["name"], driver=device["driver"],
                       threads="\nEvery program had one thread, pinned to one core." if device["type"] == "CPU" else "",
                       peak=results.get("layer", "peak", "raymeld", "gflop_per_s"), frames=frames, beside=beside,
                       options=options, kernels=kernels, rounds=device["rounds"], memory=memory, layers=layers,
                       onednn=ONEDNN if "onednn" in layers else "")
    (docs / "performance.md").write_text(text)

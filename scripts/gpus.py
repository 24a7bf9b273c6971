"""Compiles the kernels of models for GPUs that are not there, and says what their compilers tell of each.

Mesa's drivers run on Debian sid's mesa-drm-shim, unpacked into build/sid: pipelines are compiled by the compilers that
users run, and nothing is computed. The program must have been built.
"""

import json
import os
import pathlib
import re
import subprocess
from typing import NamedTuple

ROOT = pathlib.Path(__file__).resolve().parent.parent
SID = ROOT / "build/sid"


class Driver(NamedTuple):
    shim: str
    file: str  # names the JSON file of the driver
    variable: str  # names the environment variable that selects the GPU
    trips: int  # counts the trips that the driver assumes of a loop of unknown length
    figures: dict  # for each of FIGURES the driver's statistics, whose sum means the same on every driver
    # Where `cycles` are those of a subgroup that runs alone, this statistic counts its instructions, and the waves of
    # FIGURES are those of so many units.
    instructions: str = ""
    units: int = 1


class Gpu(NamedTuple):
    driver: Driver
    selected: str
    name: str
    simds: int  # counts the units that issue instructions
    # A unit does so many multiply-adds a cycle: in 32 bits, in packed 16 bits, and by matrices of 16 bits with 32-bit
    # sums, where 0 stands for no matrices.
    fma: int
    half: int
    matrix: int = 0


# The cycles are those of a subgroup. They are comparable only for one kernel and GPU.
FIGURES = ("registers", "spills", "scratch_bytes", "shared_bytes", "waves", "cycles")
RADV = Driver(
    "amdgpu",
    "radeon",
    "AMDGPU_GPU_ID",
    8,
    {
        "registers": ["VGPRs"],
        "spills": ["Spilled VGPRs", "Spilled SGPRs"],
        "scratch_bytes": ["Scratch size"],
        "shared_bytes": ["LDS size"],
        "waves": ["Subgroups per SIMD"],
        "cycles": ["Inverse Throughput"],
    },
)
NVK = Driver(
    "nouveau",
    "nouveau",
    "NOUVEAU_CHIPSET",
    10,
    {
        "registers": ["Number of GPRs"],
        "spills": ["Spills to memory"],
        "scratch_bytes": ["SLM size"],
        "waves": ["Max warps/SM"],
        "cycles": ["Static cycle count"],
    },
    "Instruction count",
    4,
)
HONEYKRISP = Driver(
    "asahi",
    "asahi",
    "",
    1,
    {
        "registers": ["GPRs"],
        "spills": ["Spills"],
        "scratch_bytes": ["Scratch"],
        "waves": ["Threads"],
        "cycles": ["ALU", "IC"],
    },
)
TURNIP = Driver(
    "freedreno",
    "freedreno",
    "FD_GPU_ID",
    1,
    {
        "registers": ["Registers used"],
        "spills": ["STP Count"],
        "waves": ["Max Waves Per Core"],
        "cycles": ["Instruction Count", "Estimated cycles stalled on SS", "Estimated cycles stalled on SY"],
    },
)
# The units and their rates are those that the makers publish for the card that is named.
GPUS = {
    "navi10": Gpu(RADV, "navi10", "RX 5700 XT", 80, 32, 64),
    "navi21": Gpu(RADV, "navi21", "RX 6900 XT", 160, 32, 64),
    "navi31": Gpu(RADV, "navi31", "RX 7900 XTX", 192, 64, 128, 128),
    "gfx1201": Gpu(RADV, "gfx1201", "RX 9070 XT", 128, 64, 128, 256),
    "vega10": Gpu(RADV, "vega10", "RX Vega 64", 256, 16, 32),
    "turing": Gpu(NVK, "162", "RTX 2080 Ti", 272, 16, 32, 64),
    "ada": Gpu(NVK, "192", "RTX 4090", 512, 32, 32, 64),
    "blackwell": Gpu(NVK, "1b2", "RTX 5090", 680, 32, 32, 64),
    "m1": Gpu(HONEYKRISP, "", "Apple M1", 32, 32, 32),
    "adreno740": Gpu(TURNIP, "740", "Adreno 740", 12, 64, 128),
}


def unpack():
    subprocess.run([ROOT / "scripts/unpack-sid"], check=True, stdout=subprocess.DEVNULL)


def file_of(model):
    """Returns the file of a stock model, or of x8-full, with random weights if no weights are shipped."""
    shipped, random = (ROOT / folder / f"{model}.safetensors" for folder in ("models", "build/gpus"))
    made_from = max((ROOT / "training" / name).stat().st_mtime for name in ("stock.py", "model.py"))
    if not shipped.exists() and not (random.exists() and random.stat().st_mtime > made_from):
        shape = "8,64,64,4,5,3" if model == "x8-full" else model
        random.parent.mkdir(parents=True, exist_ok=True)
        options = ("--untrained", shape, "--name", model, "--out", random)
        subprocess.run(["/usr/bin/python3", ROOT / "training/export.py", *options], check=True)
    return shipped if shipped.exists() else random


def program():
    return pathlib.Path(os.environ.get("RAYMELD", ROOT / "build/release/raymeld")).resolve()


def run(gpu, *command):
    """Runs a command on a GPU that is not there; returns its output. The driver keeps what it compiles."""
    driver = GPUS[gpu].driver
    file = str(SID / f"root/usr/share/vulkan/icd.d/{driver.file}_icd.json")
    environment = os.environ | {"PRELOAD": f"lib{driver.shim}_noop_drm_shim.so", "VK_DRIVER_FILES": file}
    cache = str(ROOT / "build/gpus/cache")
    environment |= {"MESA_SHADER_CACHE_DIR": cache, "XDG_CACHE_HOME": cache}
    environment |= {driver.variable: GPUS[gpu].selected} if driver.variable else {}
    command = list(map(str, command))
    ended = subprocess.run([SID / "run", *command], env=environment, capture_output=True, text=True)
    if ended.returncode != 0:
        raise RuntimeError(f"{gpu}: {' '.join(command)}: {(ended.stdout + ended.stderr).strip()}")
    return ended.stdout


def figures(gpu, kernel, executables="executables"):
    """Returns a value for each of FIGURES."""
    statistics = {}
    for executable in kernel[executables]:
        statistics |= executable["statistics"]
    names = GPUS[gpu].driver.figures
    missing = {name for of in names.values() for name in of} - set(statistics)
    if missing:
        raise RuntimeError(f"{gpu}: {kernel['kernel']}: the driver no longer tells {', '.join(sorted(missing))}")
    return {figure: sum(int(statistics[name]) for name in names.get(figure, ())) for figure in FIGURES}


def instructions(gpu, executables):
    return sum(executable["statistics"][GPUS[gpu].driver.instructions] for executable in executables)


def compiled(gpu, model, precision, size, *options):
    """Returns what `raymeld compile --json` says, with the driver as "Mesa 26.2".

    Each kernel has its `figures`, and `step`, the cycles of one step of its loops of unknown length; where the driver
    counts instructions, also `issued`, those outside of these loops and those of a step.
    """
    arguments = ("--model", model, "--size", size, "--precision", precision, "--json", *options)
    result = json.loads(run(gpu, program(), "compile", *arguments))
    result["driver"] = re.sub(r"(Mesa \d+\.\d+).*", r"\1", result["driver"])
    for kernel in result["kernels"]:
        kernel["figures"] = figures(gpu, kernel)
        unrolled = figures(gpu, kernel, "unrolled" if kernel["unrolled"] else "executables")
        kernel["step"] = (unrolled["cycles"] - kernel["figures"]["cycles"]) / GPUS[gpu].driver.trips
        if GPUS[gpu].driver.instructions:
            counts = [instructions(gpu, kernel[of]) for of in ("executables", "unrolled") if kernel[of]]
            kernel["issued"] = (2 * counts[0] - counts[-1], counts[-1] - counts[0])
    return result


def subgroups_of_unit(gpu, kernel, layer):
    """Returns how many subgroups each unit of the GPU runs for a layer."""
    subgroups = -(-kernel["invocations"] // kernel["executables"][0]["subgroup_size"])
    return layer["workgroups"] * subgroups / GPUS[gpu].simds


def layer_cycles(gpu, kernel):
    """Returns {layer: cycles} that a kernel takes of the whole GPU, by what its compiler counts.

    Every subgroup takes its cycles at full throughput. A loop counts as often as it runs, not as often as the compiler
    assumes.
    """
    outside = kernel["figures"]["cycles"] - GPUS[gpu].driver.trips * kernel["step"]
    return {
        layer["name"]: subgroups_of_unit(gpu, kernel, layer) * (outside + layer["loop_trips"] * kernel["step"])
        for layer in kernel["layers"]
    }


def overlapped_cycles(gpu, kernel):
    """Returns the same as layer_cycles() where subgroups hide each other's waits, or {} if nothing is known of that.

    A unit then takes the cycles of a lone subgroup for as many as it keeps at a time, but at least a cycle for each
    instruction and, by matrices, what the multiply-adds of the layer take.
    """
    about = GPUS[gpu]
    if not about.driver.instructions:
        return {}
    alone, (outside, step) = layer_cycles(gpu, kernel), kernel["issued"]
    kept = max(1, kernel["figures"]["waves"] // about.driver.units)
    rate = about.matrix if kernel["kernel"] == "conv2d_matrix" else float("inf")
    return {
        layer["name"]: max(
            alone[layer["name"]] / kept,
            subgroups_of_unit(gpu, kernel, layer) * (outside + layer["loop_trips"] * step),
            layer["flop"] / 2 / rate / about.simds,
        )
        for layer in kernel["layers"]
    }

"""Chooses the program's kernels, by its options or by a tuning written here in the place of a measured one."""

import dataclasses
import json
import os
import pathlib
import subprocess

TINY = pathlib.Path(__file__).resolve().parent.parent.parent / "tests/golden/tiny-x2.safetensors"


@dataclasses.dataclass(frozen=True)
class Choice:
    """Describes the kernels of a run.

    `kernel` is the kernel of 3x3 convolutions as a tuning has it, by matrices without the device's numbers and for 1x1
    convolutions too. None leaves the choice to the program.
    """

    precision: str
    name: str
    options: tuple = ()
    kernel: dict = None

    @property
    def uses_matrices(self):
        return bool(self.kernel and self.kernel["algorithm"] == "matrix")

    def start(self, program, folder, driver=None):
        """Returns the arguments with which jobs.fuse() starts the program with these kernels.

        `folder` holds caches, with no tunings but those written here.
        """
        # The program ignores a relative path and would use the user's own cache.
        cache = folder.resolve() / f"cache {self.name}"
        start = {"launcher": (), "environment": os.environ | {"XDG_CACHE_HOME": str(cache)}}
        if self.uses_matrices:
            drivers = driver.resolve().parent / "root/usr/share/vulkan/icd.d"
            start["launcher"] = (driver,)
            start["environment"]["VK_DRIVER_FILES"] = str(drivers / "lvp_icd.json")
        if self.kernel:
            self.tune(program, **start)
        return start

    def tune(self, program, launcher, environment):
        folder = pathlib.Path(environment["XDG_CACHE_HOME"])
        if any(folder.glob(f"raymeld/tuning-*-{self.precision}.json")):
            return

        def said(*command):
            command = [*launcher, program, *command, "--json"]
            return json.loads(subprocess.run(command, env=environment, capture_output=True, check=True).stdout)

        path = pathlib.Path(said("tune", "--model", TINY, "--size", "8x8", "--precision", self.precision)["file"])
        if not path.is_relative_to(folder):
            raise RuntimeError(f"the program keeps its tuning in '{path}', expected a file in '{folder}'")
        tuning = json.loads(path.read_text())
        device = said("devices")["devices"][0]
        sides = (1, 3, 5) if self.kernel["algorithm"] == WINOGRAD["algorithm"] else (1, 3)
        tuning["conv2d"] = [entry(side, self.kernel, device) for side in sides]
        path.write_text(json.dumps(tuning))


def entry(side, kernel, device):
    """Returns a tuning's only entry for this side of kernels, so that every shape takes it."""
    shape = dict(height=64, width=64, channels_in=16, channels_out=16, kernel=side, most_tile=4)
    shape |= dict(unshuffle=1, shuffle=1)
    if kernel["algorithm"] == "matrix":
        kernel = kernel | {"matrix": kernel["matrix"] | sizes(device)}
    elif side == 1:
        kernel = POINTWISE
    return {"shape": shape, "kernel": kernel, "time_ms": 1, "direct_ms": 1}


def sizes(device):
    """Returns sizes of matrices; the last two are those of Mesa's driver for CPUs, as `devices` does not tell them."""
    m, n, k = map(int, device["cooperative_matrix"].split("x"))
    return dict(m=m, n=n, k=k, subgroup_size=device["subgroup_size"], max_invocations=1024, max_shared_bytes=32768)


PARAMETERS = dict(outputs=16, channels=64, order=8, vector=0)
POINTWISE = dict(algorithm="pointwise", band=2048) | PARAMETERS
WINOGRAD = dict(algorithm="winograd", tile=2, band=256) | PARAMETERS
CHOICES = [
    *(Choice(precision, "direct", ("--kernels", "direct")) for precision in ("fp32", "fp16")),
    *(Choice(precision, "F(2, 3)", kernel=WINOGRAD) for precision in ("fp32", "fp16")),
    *(Choice(precision, "auto") for precision in ("fp32", "fp16")),
]
# Matrices exist in 16 bits only.
TILES = dict(outputs=16, rows=2, subgroups=4, channels=16)
MATRICES = Choice("fp16", "matrices", kernel=dict(algorithm="matrix", matrix=TILES))

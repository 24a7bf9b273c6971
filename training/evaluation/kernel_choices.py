"""Which kernels the program uses: by its options, or by a tuning of ours in the place of one that was measured."""

import dataclasses
import json
import os
import pathlib
import subprocess

TINY = pathlib.Path(__file__).resolve().parent.parent.parent / "tests/golden/tiny-x2.safetensors"


@dataclasses.dataclass(frozen=True)
class Choice:
    """`kernel`: tune's entry for 3x3 and 1x1, but for what is 0 or the device's; None: what the program chooses."""

    precision: str
    name: str
    options: tuple = ()
    kernel: dict = None

    @property
    def uses_matrices(self):
        return bool(self.kernel and self.kernel["matrix"])

    def start(self, program, folder, driver=None):
        """What jobs.fuse() needs to start the program with these kernels.

        `folder`: of caches, with no tuning but ours.
        """
        # Of a relative path the program would take no notice, and use the user's own.
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
        tuning["conv2d"] = [entry(side, self.kernel, device) for side in (1, 3)]
        path.write_text(json.dumps(tuning))


def entry(side, kernel, device):
    """Of a tuning with no other entry for this side, so that every shape takes it."""
    shape = dict(height=64, width=64, channels_in=16, channels_out=16, kernel=side, most_tile=4)
    kernel = DEFAULTS | kernel
    if kernel["matrix"]:
        kernel["matrix"] = kernel["matrix"] | sizes(device)
    elif side == 1:
        kernel = kernel | POINTWISE
    return {"shape": shape, "kernel": kernel, "time_ms": 1, "direct_ms": 1}


def sizes(device):
    """Of matrices; the last two are those of Mesa's driver for CPUs, as `devices` does not say them."""
    m, n, k = map(int, device["cooperative_matrix"].split("x"))
    return dict(m=m, n=n, k=k, subgroup_size=device["subgroup_size"], max_invocations=1024, max_shared_bytes=32768)


DEFAULTS = dict(tile=0, outputs=16, channels=64, order=8, band=256, matrix=None)
POINTWISE = dict(tile=1, band=2048)
CHOICES = [
    *(Choice(precision, "direct", ("--kernels", "direct")) for precision in ("fp32", "fp16")),
    *(Choice(precision, "F(2, 3)", kernel=dict(tile=2, matrix=None)) for precision in ("fp32", "fp16")),
    *(Choice(precision, "auto") for precision in ("fp32", "fp16")),
]
# In 16 bits only; the profile says whether they were used.
TILES = dict(outputs=16, rows=2, subgroups=4, channels=16)
MATRICES = Choice("fp16", "matrices", ("--profile",), kernel=dict(matrix=TILES))

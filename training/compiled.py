"""Compiles C++ beside the scripts when it is first used."""

import ctypes
import functools
import pathlib
import subprocess
import tempfile

import torch


@functools.cache
def library(source):
    """Returns the library of a source file; it is compiled for this processor."""
    with tempfile.TemporaryDirectory() as folder:
        compiled, built = (pathlib.Path(folder) / f"{source.stem}.{ending}" for ending in ("o", "so"))
        options = ["-O3", "-march=native", "-ffast-math", "-fPIC"]
        subprocess.run(["g++", *options, "-c", source, "-o", compiled], check=True)
        # A library linked with -ffast-math would flush subnormals for the whole process.
        subprocess.run(["g++", "-shared", compiled, "-o", built], check=True)
        return ctypes.CDLL(str(built))


def takes(x):
    """Returns whether the compiled functions take a tensor; others are left to PyTorch."""
    return x.device.type == "cpu" and x.dtype == torch.float32


def pointer(tensor):
    return ctypes.c_void_p(tensor.data_ptr())

"""Reads and writes safetensors files: a JSON header with shapes and offsets, then the tensors, little endian."""

import json
import struct

import numpy

TYPES = {"float32": "F32", "float16": "F16", "uint8": "U8"}


def save(path, tensors, metadata):
    header, offset = {"__metadata__": metadata}, 0
    arrays = {name: numpy.ascontiguousarray(tensor) for name, tensor in tensors.items()}
    for name, array in arrays.items():
        span = [offset, offset + array.nbytes]
        header[name] = {"dtype": TYPES[str(array.dtype)], "shape": list(array.shape), "data_offsets": span}
        offset += array.nbytes
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(text)) + text)
        for array in arrays.values():
            file.write(array.tobytes())


class Lazy:
    """Reads the tensors of a file one by one."""

    def __init__(self, path):
        self.path = path
        with open(path, "rb") as file:
            size = struct.unpack("<Q", file.read(8))[0]
            header = json.loads(file.read(size))
        self.metadata, self.entries, self.start = header.pop("__metadata__", {}), header, 8 + size

    def read(self, name):
        """Returns the tensor as a memory map, which reads only the parts that are used."""
        entry = self.entries[name]
        kind = numpy.dtype(next(long for long, short in TYPES.items() if short == entry["dtype"]))
        offset, shape = self.start + entry["data_offsets"][0], tuple(entry["shape"])
        return numpy.memmap(self.path, kind, "c", offset, shape).view(numpy.ndarray)


def load(path):
    """Returns (tensors by name, metadata)."""
    file = Lazy(path)
    return {name: file.read(name) for name in file.entries}, file.metadata

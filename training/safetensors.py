"""Writes safetensors files: a JSON header with shapes and offsets, then the tensors, little endian."""

import json
import struct

import numpy

TYPES = {"float32": "F32", "float16": "F16"}


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

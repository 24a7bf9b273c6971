"""Times whole frames in PyTorch, with raymeld's weights, and prints one JSON object.

pytorch_frame.py MODEL WIDTHxHEIGHT fp32|bf16|fp16 FOLDER [eager]: FOLDER holds lrhs.raw and hrls.raw, planar floats, or
the inputs are random; the output is written to FOLDER/pytorch.raw. Where CUDA has a GPU, the inputs lie on it, and the
network is compiled for it unless `eager` is given; else it runs on one CPU thread.
"""

import json
import pathlib
import statistics
import sys
import time

import numpy
import torch

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "training"))

import model as networks

SECONDS, FRAMES = 3.0, 3  # the least that a measurement takes
MOST_SECONDS = 10.0  # of fewer frames, as x4-edsr-full takes a minute in bf16; rounds measure it again


@torch.no_grad()
def main(path, size, precision, folder, eager=False):
    torch.set_num_threads(1)
    torch.backends.cudnn.allow_tf32 = False  # fp32 must not mean TF32
    device = "cuda" if torch.cuda.is_available() else "cpu"
    dtype = torch.float16 if precision == "fp16" else torch.bfloat16
    width, height = map(int, size.split("x"))
    network = networks.load(path).to(memory_format=torch.channels_last)
    scale, layers = network.config.scale, max(1, len(network.config.hrls_layers))

    def image(name, channels, h, w):
        file = folder / f"{name}.raw"
        if not file.exists():
            return torch.rand(1, channels, h, w, generator=torch.Generator().manual_seed(1))
        return torch.from_numpy(numpy.fromfile(file, dtype=numpy.float32)).reshape(1, channels, h, w)

    lrhs = image("lrhs", 3, height // scale, width // scale)
    hrls = image("hrls", 3 * layers, height, width)
    exposure = networks.exposure(lrhs if network.config.reads_lrhs else hrls[:, :3], network.config)
    gains = torch.ones(1, 3 * layers, 1, 1)
    for i, name in enumerate(network.config.hrls_layers):
        gains[:, 3 * i : 3 * i + 3] = {"albedo": 1, "normal": 1, "variance": exposure**2}.get(name, exposure)
    lrhs, hrls, network = (lrhs * exposure).to(device), (hrls * gains).to(device), network.to(device)
    predict = torch.compile(networks.predict) if device == "cuda" and not eager else networks.predict

    def frame():
        with torch.autocast(device, dtype, enabled=precision != "fp32"):
            result = predict(network, lrhs, hrls)[1].float() / exposure
        if device == "cuda":
            torch.cuda.synchronize()
        return result

    fused = frame()
    times = []
    while sum(times) < SECONDS or len(times) < FRAMES and sum(times) < MOST_SECONDS:
        start = time.perf_counter()
        frame()
        times.append(time.perf_counter() - start)
    fused.clamp(0, 65504).cpu().numpy().tofile(folder / "pytorch.raw")
    print(json.dumps({"time_s": statistics.median(times), "size": size}))


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), *sys.argv[2:4], pathlib.Path(sys.argv[4]), sys.argv[5:] == ["eager"])

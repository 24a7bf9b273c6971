#!/usr/bin/env python3
"""Writes tiny networks, inputs and every layer's output in float64 for the engine's tests: goldens.py FOLDER."""

import pathlib
import sys

import numpy
import torch

import export
import model
import safetensors

CASES = {
    "tiny-x2": ((5, 7), model.Config(2, 6, 5, 2, 2, 1, transfer="linear", clip=100.0, base="none")),
    "tiny-x4": (
        (7, 5),
        model.Config(4, 5, 3, 3, 1, 2, ("color", "normal", "albedo"), "fused", True, base="bilinear"),
    ),
    "tiny-x8": ((3, 5), model.Config(8, 4, 6, 1, 2, 1, long_skip="fused", transfer="log", base="none")),
    "guided-x2": (
        (5, 3),
        model.Config(
            2,
            4,
            3,
            1,
            1,
            1,
            ("color", "normal"),
            hrls_encoder="unshuffled",
            guide="hrls",
            head_features=5,
            head_layers=1,
            lrhs_sampling=("centered", "nearest"),
            optional_layers=("normal",),
        ),
    ),
    "guided-x4": (
        (3, 5),
        model.Config(
            4,
            5,
            3,
            1,
            1,
            1,
            ("color", "albedo", "normal", "variance"),
            hrls_encoder="unshuffled",
            upscale="direct",
            upscaled_features=3,
            guide="hrls",
            head_features=6,
            head_layers=2,
            lrhs_sampling=("nearest", "centered"),
            optional_layers=("albedo", "variance"),
            exposure_key=0.2,
        ),
    ),
    "guided-x8": (
        (2, 3),
        model.Config(
            8, 3, 2, 1, 1, 1, ("color", "diffuse"), upscale="direct", upscaled_features=2, guide="hrls", base="none"
        ),
    ),
    "spp-x4": (
        (4, 3),
        model.Config(
            4,
            4,
            3,
            1,
            1,
            1,
            ("color", "albedo", "normal"),
            hrls_encoder="unshuffled",
            hrls_kernel=1,
            upscale="direct",
            upscaled_features=3,
            guide="hrls",
            head_features=5,
            head_layers=3,
            lrhs_sampling=("centered", "nearest"),
            knows_spp=True,
        ),
    ),
    "pyramid-x2": (
        (9, 5),
        model.Config(
            2,
            hrls_layers=("color", "albedo", "normal", "variance"),
            upscaled_features=3,
            lrhs_sampling=("centered", "nearest"),
            lrhs_certainty=4.0,
            optional_layers=("albedo", "variance"),
            exposure_key=0.2,
            clip=10.0,
            knows_spp=True,
            network="pyramid",
            widths=("3", "2", "3", "2"),
        ),
    ),
    "edsr-x4": (
        (5, 7),
        model.Config(
            4,
            5,
            blocks=2,
            clip=50.0,
            lrhs_sampling=("centered",),
            exposure_key=0.2,
            network="edsr",
        ),
    ),
    "rcan-x2": (
        (5, 7),
        model.Config(
            2,
            5,
            blocks=1,
            groups=2,
            squeezed_features=4,
            clip=50.0,
            lrhs_sampling=("nearest",),
            exposure_key=0.3,
            network="rcan",
        ),
    ),
    "kpcn-x1": (
        (13, 18),
        model.Config(
            1,
            4,
            hrls_layers=("color", "albedo", "normal", "diffuse", "variance"),
            optional_layers=("diffuse",),
            exposure_key=0.3,
            clip=20.0,
            network="kpcn",
            depth=3,
            kernel_side=7,
        ),
    ),
    "pyramid-x1": (
        (13, 18),
        model.Config(
            1,
            hrls_layers=("color", "albedo", "normal", "variance"),
            upscaled_features=3,
            optional_layers=("variance",),
            exposure_key=0.3,
            clip=20.0,
            knows_spp=True,
            network="pyramid",
            widths=("2", "3", "2", "3"),
        ),
    ),
    "pyramid-x4": (
        (3, 6),
        model.Config(
            4,
            hrls_layers=("color", "albedo", "normal"),
            upscaled_features=2,
            lrhs_certainty=10.0,
            transfer="linear",
            clip=5.0,
            network="pyramid",
            widths=("2", "3", "2", "3"),
        ),
    ),
}
SPP = {"spp-x4": (64.0, 2.0), "pyramid-x2": (8.0, 3.0), "pyramid-x1": (1.0, 6.0)}  # samples a pixel of LRHS and HRLS
CENTERED = ("guided-x4", "spp-x4", "edsr-x4", "pyramid-x2")  # LRHS is centered here, else nearest samples


def random_network(config, generator):
    """Returns a network whose weights have 8 significant bits, so that bfloat16 and half hold them exactly."""
    network = model.create(config)
    for name, value in network.state_dict().items():
        fan_in = value[0].numel() if value.dim() == 4 else 1
        bound = (3 / fan_in) ** 0.5 if value.dim() == 4 else 0.2
        # Bounds of larger weights are of no use where many layers follow each other or many inputs are summed up.
        bound /= {"pyramid": 2, "rcan": 2, "kpcn": 8}.get(config.network, 1)
        fresh = (torch.rand(value.shape, generator=generator) * 2 - 1) * bound
        value.copy_(fresh.bfloat16().half().float())  # half has fewer small numbers
    return network.double().eval()


def random_inputs(shape, config, generator):
    h, w = shape
    k, s = 3 * len(config.hrls_layers), config.scale
    lrhs = torch.rand(1, 3, h, w, generator=generator) ** 3 * 4
    hrls = torch.rand(1, k, h * s, w * s, generator=generator) ** 3 * 4
    lrhs[0, :, 1, 2] = torch.tensor([5000.0, 20.0, 60000.0])
    hrls[0, :, 3, 4] = 300.0
    hrls[0, :1, -1, -1] = 60000.0
    if "normal" in config.hrls_layers:
        normal = 3 * config.hrls_layers.index("normal")
        hrls[:, normal : normal + 3] -= 1.5
    return lrhs.float(), hrls.float()


def layer_outputs(network, run):
    """Returns the output of each layer by name, after its activation, shuffle or addition."""
    if network.config.network in ("pyramid", "kpcn", *model.UPSCALERS):
        network.outputs = {}
        return {"output": run()[1]} | network.outputs
    seen = {}
    scale = network.config.scale
    factor = scale if network.config.upscale == "direct" else 2
    after = {
        "": lambda y: y.relu(),
        "up": lambda y: torch.pixel_shuffle(y.relu(), factor),
        "rec": lambda y: y,
    }
    encode_lrhs = network.encode_lrhs  # adds the bias of centered samples after its convolution
    network.encode_lrhs = lambda *inputs: seen.setdefault("lrhs", encode_lrhs(*inputs))
    encode_hrls = network.encode_hrls  # adds the bias by samples after its convolution

    def see_hrls(*inputs):
        f_hrls = encode_hrls(*inputs)
        if network.config.knows_spp:
            seen["hrls"] = f_hrls
        return f_hrls

    network.encode_hrls = see_hrls
    for name, part in network.named_modules():
        if isinstance(part, torch.nn.Conv2d) and name != "lrhs" and not name.endswith("merge"):
            then = after.get(name.split(".")[0], after[""])
            adds = name.startswith("head.") and not name.endswith(".0")
            see = lambda _, x, y, name=name, then=then, adds=adds: seen.update({name: then(y) + (x[0] if adds else 0)})
            part.register_forward_hook(see)
        elif isinstance(part, model.Block):
            part.register_forward_hook(lambda _, __, y, name=name + ".merge": seen.update({name: y}))
    output = run()[1]
    return seen | {"output": output}


def exposed(hrls, config, exposure):
    """Exposes the layers of HRLS as a network with an exposure_key reads them."""
    power = {"albedo": 0, "normal": 0, "variance": 2}
    if not config.hrls_layers:
        return hrls
    layers = zip(hrls.split(3, dim=1), config.hrls_layers, strict=True)
    return torch.cat([layer * exposure ** power.get(name, 1) for layer, name in layers], dim=1)


def write_case(folder, name, shape, config):
    generator = torch.Generator().manual_seed(config.scale)
    network = random_network(config, generator)
    lrhs, hrls = random_inputs(shape, config, generator)
    if not config.reads_lrhs:
        lrhs = hrls[:, :3]
    tensors = {"lrhs_input": lrhs} | ({"hrls_input": hrls} if config.hrls_layers else {})
    centered = torch.tensor(name in CENTERED)
    exposure = float(numpy.float32(model.exposure(lrhs.double(), config)))

    spp = torch.tensor(SPP[name], dtype=torch.float64).reshape(1, 2, 1, 1) if name in SPP else None

    def run():
        inputs = lrhs.double() * exposure, exposed(hrls.double(), config, exposure)
        encoded, output = model.predict(network, *inputs, centered, exposure, spp)
        return encoded, (output / exposure).clamp(max=model.HALF_MAX)

    tensors |= layer_outputs(network, run)
    half = not name.startswith("tiny")
    export.write(folder / f"{name}.safetensors", name, config, network.float().state_dict(), {"untrained": True}, half)
    stored = {key: value[0].float().numpy() for key, value in tensors.items()}
    metadata = {"model": name, "lrhs_sampling": "centered" if centered else "nearest", "exposure": repr(exposure)}
    if name in SPP:
        metadata |= dict(zip(("lrhs_spp", "hrls_spp"), map(str, SPP[name])))
    safetensors.save(folder / f"{name}.golden.safetensors", stored, metadata)


def main():
    torch.set_grad_enabled(False)
    folder = pathlib.Path(sys.argv[1])
    for name, case in CASES.items():
        write_case(folder, name, *case)


main()

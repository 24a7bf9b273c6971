"""Renders one seeded view at several sample counts, each a multilayer EXR with its own noise.

blender -b -P training/scenes/render.py -- --out VIEW --seed 7 --catalogue A.sh3f [...] --spp 1 2 4 8 --plain-spp 16 64
"""

import argparse
import faulthandler
import json
import pathlib
import random
import sys
import tempfile

import bpy
import numpy

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import build
import furniture
import room

faulthandler.enable()
KINDS = {"room": room.room, "studio": build.studio, "outdoor": build.outdoor}
LAYERS = (
    "diffuse_direct diffuse_indirect diffuse_color glossy_direct glossy_indirect glossy_color "
    "transmission_direct transmission_indirect transmission_color emit environment normal z"
).split()
# The layers that a fusion reads: no transmission, emission, environment, shading normal or depth.
FUSION_LAYERS = LAYERS[:6]


def parse():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", required=True, type=pathlib.Path, help="folder of this view")
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--catalogue", required=True, nargs="+")
    parser.add_argument("--kind", choices=KINDS, help="default: by seed")
    parser.add_argument("--width", type=int, default=192)
    parser.add_argument("--height", type=int, default=192)
    parser.add_argument("--spp", type=int, nargs="*", default=[], help="renders with every layer")
    parser.add_argument("--plain-spp", type=int, nargs="*", default=[], help="renders with the colour only; a count that comes again gets another seed")
    parser.add_argument("--layers", choices=("all", "fusion"), default="fusion")
    parser.add_argument("--depth", choices=("16", "32"), default="16", help="bits a channel")
    parser.add_argument("--threads", type=int, default=1)
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1 :])


def set_up(args):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = args.width, args.height
    scene.render.threads_mode, scene.render.threads = "FIXED", args.threads
    scene.render.use_persistent_data = True
    scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.image_settings.color_depth = args.depth
    scene.render.image_settings.exr_codec = "ZIP"
    cycles = scene.cycles
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.max_bounces, cycles.transmission_bounces = 6, 6
    return scene


def choose_layers(scene, names):
    layer = scene.view_layers[0]
    for name in LAYERS:
        setattr(layer, "use_pass_" + name, name in names)
    layer.cycles.denoising_store_passes = bool(names)


def render(scene, path, spp, seed):
    scene.cycles.samples = spp
    scene.cycles.seed = seed
    partial = path.with_suffix(".part.exr")
    scene.render.filepath = str(partial)
    bpy.ops.render.render(write_still=True)
    partial.rename(path)


def expose(scene, rng, folder):
    """Sets the exposure that brings the mean display value of a small probe to a random 0.28..0.5."""
    size = scene.render.resolution_x, scene.render.resolution_y
    scene.render.resolution_percentage = max(5, 100 * 48 // max(size))
    choose_layers(scene, ())
    probe = pathlib.Path(folder) / "probe.exr"
    scene.render.image_settings.file_format = "OPEN_EXR"
    render(scene, probe, 16, 1)
    scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.resolution_percentage = 100
    pixels = numpy.array(bpy.data.images.load(str(probe)).pixels[:]).reshape(-1, 4)[:, :3]
    target, low, high = rng.uniform(0.28, 0.5), 1e-4, 1e4
    for _ in range(40):
        middle = (low * high) ** 0.5
        shown = numpy.clip(pixels * middle, 0, 1) ** (1 / 2.2)
        low, high = (middle, high) if shown.mean() < target else (low, middle)
    scene.cycles.film_exposure = min(middle, 10000)
    return float(scene.cycles.film_exposure)


def main():
    args = parse()
    rng = random.Random(args.seed)
    kind = args.kind or rng.choices(list(KINDS), (75, 15, 10))[0]
    models = [m for path in args.catalogue for m in furniture.read_catalogue(path)]
    textures = [t for path in args.catalogue for t in furniture.read_textures(path)]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with tempfile.TemporaryDirectory() as folder:
        builder = build.Builder(rng, models, textures, folder)
        KINDS[kind](builder)
        scene = set_up(args)
        exposure = expose(scene, rng, folder)
        args.out.mkdir(parents=True, exist_ok=True)
        for names, counts in ((FUSION_LAYERS if args.layers == "fusion" else LAYERS, args.spp), ((), args.plain_spp)):
            choose_layers(scene, names)
            for index, spp in enumerate(counts):
                repeat = counts[:index].count(spp)
                path = args.out / (f"{spp:04}-{repeat}.exr" if repeat else f"{spp:04}.exr")
                if not path.exists():
                    render(scene, path, spp, args.seed * 10007 + spp + 100000 * repeat)
    record = {"seed": args.seed, "kind": kind, "exposure": exposure, "models": builder.used}
    (args.out / "view.json").write_text(json.dumps(record, indent=1) + "\n")


main()

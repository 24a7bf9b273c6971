"""Renders the views of one seeded scene: noisy renders, each with its own noise, and the reference in two parts.

blender -b --factory-startup -P training/scenes/render.py -- --out VIEW --seed 7 --catalogue A.sh3f [...] --spp 1 2 4

Another run goes on with the files that are missing. VIEW/view.json tells what the files are; it has `whole` once all
are there. A view that is flat, black, white or too noisy to learn from leaves only view.json, with `dropped`.
With several folders after --out, each is another window of the same frame (--frame).
"""

import argparse
import contextlib
import faulthandler
import json
import pathlib
import random
import sys
import tempfile
import time

import bpy
import numpy
import OpenImageIO as oiio

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import build
import details
import furniture
import kinds
import room
import shapes
import test_scenes

faulthandler.enable()
VERSION = 2  # the generator's, raised when a seed gives another scene
# A kind with a share of 0 is for --kind alone; raising a share changes the scenes that seeds give.
KINDS = {
    "room": (room.room, 36),
    "tabletop": (kinds.tabletop, 18),
    "studio": (kinds.studio, 14),
    "outdoor": (kinds.outdoor, 12),
    "landscape": (kinds.landscape, 10),
    "architecture": (kinds.architecture, 10),
    "details": (details.details, 0),
}
LAYERS = (
    "diffuse_direct diffuse_indirect diffuse_color glossy_direct glossy_indirect glossy_color "
    "transmission_direct transmission_indirect transmission_color emit environment normal z"
).split()
# `fusion` has the layers that a fusion reads; `light` adds emission and environment, which are seen directly.
LAYER_SETS = {
    "all": LAYERS,
    "fusion": LAYERS[:6],
    "light": [*LAYERS[:6], "emit", "environment"],
}
MOST_RELMSE = 0.01
WINDOW_STEP = 8  # pixels; windows lie on multiples of it, so that their smaller renders have whole pixels
PILOT_SPP = 32  # samples of a half's pilot, which tells how many the half needs


def scaled(text):
    """Parses SCALE:SPP."""
    scale, spp = map(int, text.split(":"))
    return scale, spp


def parse():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", required=True, type=pathlib.Path, nargs="+", help="a folder for each window")
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--catalogue", required=True, nargs="+")
    parser.add_argument("--kind", choices=[*KINDS, *test_scenes.KINDS], help="default: a kind for training, by seed")
    parser.add_argument("--width", type=int, default=192)
    parser.add_argument("--height", type=int, default=192)
    parser.add_argument("--frame", type=int, default=0, help="the view is a random window of a frame of this size")
    parser.add_argument("--spp", type=int, nargs="*", default=[], help="samples of renders with layers")
    parser.add_argument("--layers", choices=LAYER_SETS, default="fusion")
    parser.add_argument("--guides", type=int, nargs="*", default=[], help="samples of renders of albedo and normal")
    parser.add_argument("--plain-spp", type=int, nargs="*", default=[], help="samples of renders of the colour only")
    parser.add_argument("--lrhs", type=scaled, nargs="*", default=[], help="SCALE:SPP, render every SCALE-th pixel")
    parser.add_argument("--lowres", type=scaled, nargs="*", default=[], help="SCALE:SPP of ordinary smaller renders")
    parser.add_argument("--lowres-layers", action="store_true", help="give the smaller renders layers too")
    parser.add_argument("--reference-spp", type=int, default=0, help="most samples of both reference halves together")
    parser.add_argument("--reference-parts", type=int, nargs=2, help="samples of two reference parts with layers")
    parser.add_argument("--least-psnr", type=float, default=34, help="drop a view with a noisier reference, dB")
    parser.add_argument("--reference-psnr", type=float, help="take fewer samples if they reach this noise, dB")
    parser.add_argument("--depth", choices=("16", "32"), default="32", help="bits a channel")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :])
    if args.frame and (args.frame < max(args.width, args.height) or args.frame % WINDOW_STEP):
        parser.error(f"--frame: at least the width and the height, and a multiple of {WINDOW_STEP}")
    if len(args.out) > 1 and not args.frame:
        parser.error("--out: several windows take --frame")
    return args


def set_up(args):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = args.frame or args.width, args.frame or args.height
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


def choose_layers(scene, names, albedo=None):
    """Selects the passes beside the colour; albedo and normal come with any other pass unless `albedo` is given."""
    layer = scene.view_layers[0]
    for name in LAYERS:
        setattr(layer, "use_pass_" + name, name in names)
    layer.cycles.denoising_store_passes = bool(names) if albedo is None else albedo


@contextlib.contextmanager
def smaller(scene, scale, nearest):
    """Makes renders 1/scale of the size; if nearest, a pixel has the samples of the top-left full-size pixel in it."""
    render, camera = scene.render, scene.camera.data
    size = render.resolution_x, render.resolution_y
    if any(n % scale for n in size):
        raise ValueError(f"{size} is not a multiple of {scale}")
    render.resolution_x, render.resolution_y = (n // scale for n in size)
    width = scene.cycles.filter_width
    if nearest:
        # A pixel is as wide as `scale` full-size ones: the filter shrinks, and the centre moves up and to the left.
        scene.cycles.filter_width = width / scale
        offset = (scale - 1) / 2 / max(size)
        camera.shift_x, camera.shift_y = -offset, offset
    yield
    render.resolution_x, render.resolution_y = size
    scene.cycles.filter_width = width
    camera.shift_x = camera.shift_y = 0


@contextlib.contextmanager
def unlit(scene):
    """Ends paths where albedo and normal are known: at the first surface that is not a mirror or glass."""
    bounces = scene.cycles.diffuse_bounces
    scene.cycles.diffuse_bounces = 0
    yield
    scene.cycles.diffuse_bounces = bounces


def render(scene, path, spp, seed):
    """Renders to `path` and returns the seconds it took."""
    scene.cycles.samples = spp
    scene.cycles.seed = seed
    partial = path.with_suffix(".part.exr")
    scene.render.filepath = str(partial)
    start = time.perf_counter()
    bpy.ops.render.render(write_still=True)
    seconds = time.perf_counter() - start
    partial.rename(path)
    return round(seconds, 3)


def read_colour(path):
    """Reads the colour of a render as float32 [H, W, 3]."""
    image = oiio.ImageBuf(str(path))
    pixels = image.get_pixels(oiio.FLOAT)
    names = [name.split(".", 1)[-1] for name in image.spec().channelnames]
    return pixels[..., [names.index("Combined." + c) for c in "RGB"]]


def srgb(linear):
    x = numpy.clip(linear, 0, 1)
    return numpy.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def noise(a, b, share=0.5):
    """Returns {"relmse", "psnr"} of the mean of two independent renders by their samples, from their difference.

    `share` of the samples are a's. The variance of the difference is 1 / (share (1 - share)) times that of the mean.
    """
    mean, error = share * a + (1 - share) * b, (a - b) * (share * (1 - share)) ** 0.5
    relmse = 0.5 * error**2 / (mean**2 + 0.01)
    mse = numpy.mean((srgb(mean + error) - srgb(mean)) ** 2)
    return {"relmse": float(relmse.mean()), "psnr": float(min(100, -10 * numpy.log10(max(mse, 1e-10))))}


def too_noisy(noise, least_psnr):
    return noise["psnr"] < least_psnr or noise["relmse"] > MOST_RELMSE * 10 ** ((34 - least_psnr) / 10)


def dull(linear):
    """Returns in a word why a picture shows hardly anything, or None if it shows something."""
    shown = srgb(linear).mean(axis=2)
    if (shown < 0.02).mean() > 0.6:
        return "black"
    if (shown > 0.98).mean() > 0.5:
        return "white"
    if shown.std() < 0.05:
        return "flat"
    return None


def probe(scene, rng, folder, reference_spp, least_psnr):
    """Makes two small renders; returns (exposure, their mean at it, why the view is to be dropped or None).

    The exposure brings the mean display value to a random 0.28..0.5.
    """
    size = scene.render.resolution_x, scene.render.resolution_y
    scene.render.resolution_percentage = max(5, 100 * 64 // max(size))
    choose_layers(scene, ())
    halves = []
    for seed in (1, 2):
        path = pathlib.Path(folder) / f"probe-{seed}.exr"
        render(scene, path, 16, seed)
        halves.append(read_colour(path))
    scene.render.resolution_percentage = 100
    mean = sum(halves) / 2
    target, low, high = rng.uniform(0.28, 0.5), 1e-4, 1e4
    for _ in range(40):
        exposure = (low * high) ** 0.5
        low, high = (exposure, high) if srgb(mean * exposure).mean() < target else (low, exposure)
    exposed = noise(exposure * halves[0], exposure * halves[1])
    # Noise falls as the root of the count; 3 dB are left for the probe's own uncertainty.
    if reference_spp and exposed["psnr"] + 10 * numpy.log10(reference_spp / 32) < least_psnr - 3:
        return exposure, mean * exposure, "noise of the probe"
    return exposure, mean * exposure, dull(mean * exposure)


def choose_window(rng, small, args):
    """Returns a window in which `small` shows something, [left, top, right, bottom] in parts of the frame, or None."""
    width, height = args.width / args.frame, args.height / args.frame
    for _ in range(12):
        left, top = rng.uniform(0, 1 - width), rng.uniform(0, 1 - height)
        window = [round(edge * args.frame / WINDOW_STEP) * WINDOW_STEP / args.frame for edge in (left, top)]
        window += [window[0] + width, window[1] + height]
        columns, rows = (
            slice(*(round(n * edge) for edge in edges))
            for n, edges in zip((small.shape[1], small.shape[0]), (window[0::2], window[1::2]))
        )
        if not dull(small[rows, columns]):
            return window
    return None


def set_window(scene, window):
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = window[0], window[2]
    render.border_min_y, render.border_max_y = 1 - window[3], 1 - window[1]


def models_used(models):
    return list({m.path: m.credit for m in models}.values())


class View:
    """Holds the files of a view and its record, view.json, which is written after each file."""

    def __init__(self, args, index, scene, record):
        self.args, self.scene, self.record = args, scene, record
        self.out, self.noise_seed = args.out[index], (args.seed + 1000003 * index) * 10007
        self.out.mkdir(parents=True, exist_ok=True)

    def write(self):
        (self.out / "view.json").write_text(json.dumps(self.record, indent=1) + "\n")

    def renders(self, name, spp, seed, **about):
        """Returns the path of a render, and makes the render unless it is there."""
        path = self.out / name
        if not path.exists() or name not in self.record["files"]:
            seconds = render(self.scene, path, spp, (self.noise_seed + seed) % 2**31)
            self.record["files"][name] = {"spp": spp, "seconds": seconds} | about
            self.write()
        return path

    def merges(self, name, parts):
        """Replaces parts of a render, or a single one, by their mean by samples; returns the path of the mean."""
        path, files = self.out / name, self.record["files"]
        if name not in files:
            spp = [files[part]["spp"] for part in parts]
            images = [oiio.ImageBuf(str(self.out / part)) for part in parts]
            merged = oiio.ImageBuf(images[0].spec())
            mean = sum(n * image.get_pixels(oiio.FLOAT) for n, image in zip(spp, images)) / sum(spp)
            merged.set_pixels(images[0].spec().roi, mean)
            if not merged.write(str(path)):
                raise OSError(f"{path}: {merged.geterror()}")
            files[name] = {"spp": sum(spp), "seconds": round(sum(files.pop(part)["seconds"] for part in parts), 3)}
            self.write()
        for part in parts:
            (self.out / part).unlink(missing_ok=True)
        return path

    def reference(self):
        """Renders both halves, or only pilots of them if those promise too much noise; returns (a, b), [H, W, 3]."""
        choose_layers(self.scene, ())
        half_spp = self.args.reference_spp // 2
        if not self.args.reference_psnr:
            return [read_colour(self.renders(f"reference-{h}.exr", half_spp, 5000 + i)) for i, h in enumerate("ab")]
        pilots = ["pilot-a.exr", "pilot-b.exr"]
        if "reference_spp" not in self.record:
            images = [read_colour(self.renders(pilot, PILOT_SPP, 6000 + i)) for i, pilot in enumerate(pilots)]
            pilot_psnr = noise(*images)["psnr"]
            if pilot_psnr + 10 * numpy.log10(half_spp / PILOT_SPP) < self.args.least_psnr - 0.5:
                return images
            wanted = PILOT_SPP * 10 ** ((self.args.reference_psnr - pilot_psnr) / 10)
            self.record["reference_spp"] = 2 * max(PILOT_SPP, min(half_spp, round(wanted)))
        rest_spp = self.record["reference_spp"] // 2 - PILOT_SPP
        halves = []
        for i, (half, pilot) in enumerate(zip("ab", pilots)):
            name, rest = f"reference-{half}.exr", f"rest-{half}.exr"
            if rest_spp and name not in self.record["files"]:
                self.renders(rest, rest_spp, 5000 + i)
            halves.append(read_colour(self.merges(name, [pilot, rest] if rest_spp else [pilot])))
        return halves

    def drop(self, why):
        self.record["dropped"] = why
        for name in self.record["files"]:
            (self.out / name).unlink(missing_ok=True)

    def reference_parts(self):
        """Renders two unequal parts with layers; returns (a, b), [H, W, 3], and the share of a's samples."""
        choose_layers(self.scene, LAYER_SETS[self.args.layers])
        spp = self.args.reference_parts
        parts = [
            read_colour(self.renders(f"reference-{part}.exr", n, 5000 + i, layers=self.args.layers))
            for i, (part, n) in enumerate(zip("ab", spp))
        ]
        return parts, spp[0] / sum(spp)

    def render_all(self):
        args, scene = self.args, self.scene
        if args.reference_spp or args.reference_parts:
            halves, share = self.reference_parts() if args.reference_parts else (self.reference(), 0.5)
            self.record["noise"] = noise(*halves, share)
            noisy = too_noisy(self.record["noise"], args.least_psnr)
            why = "noise" if noisy else dull(share * halves[0] + (1 - share) * halves[1])
            if why:
                return self.drop(why)
        choose_layers(scene, LAYER_SETS[args.layers])
        for spp in args.spp:
            self.renders(f"{spp:04}.exr", spp, spp, layers=args.layers)
        choose_layers(scene, ())
        for spp in args.plain_spp:
            self.renders(f"{spp:04}.exr", spp, spp)
        for scale, spp in args.lrhs:
            choose_layers(scene, (), albedo=True)
            with smaller(scene, scale, nearest=True):
                self.renders(f"lrhs-x{scale}-{spp:04}.exr", spp, 10000 * scale + spp, scale=scale, layers="albedo")
        for scale, spp in args.lowres:
            choose_layers(scene, LAYER_SETS[args.layers] if args.lowres_layers else ())
            with smaller(scene, scale, nearest=False):
                self.renders(f"lowres-x{scale}-{spp:04}.exr", spp, 10000 * scale + 5000 + spp, scale=scale)
        for spp in args.guides:
            choose_layers(scene, (), albedo=True)
            with unlit(scene):
                self.renders(f"guides-{spp:04}.exr", spp, 7000 + spp, layers="guides")
        self.record["whole"] = True


def build_scene(args, rng, folder):
    """Returns (kind, Builder) of the seed's scene."""
    kind = args.kind or rng.choices(list(KINDS), [share for _, share in KINDS.values()])[0]
    models = [m for path in args.catalogue for m in furniture.read_catalogue(path)]
    textures = [t for path in args.catalogue for t in furniture.read_textures(path)]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    shapes.enable_add_ons()
    builder = build.Builder(rng, models, textures, folder)
    layout = test_scenes.KINDS[kind] if kind in test_scenes.KINDS else KINDS[kind][0]
    extent_m = layout(builder)
    if rng.random() < 0.12:
        builder.motion(extent_m)
    if kind != "room" and rng.random() < 0.05:
        builder.haze((-30 * extent_m,) * 3, (30 * extent_m,) * 3, rng.uniform(1, 3))
    return kind, builder


def main():
    args = parse()
    rng = random.Random(args.seed)
    # Add-ons draw from these generators.
    random.seed(args.seed)
    numpy.random.seed(args.seed)
    with tempfile.TemporaryDirectory() as folder:
        kind, builder = build_scene(args, rng, folder)
        scene = set_up(args)
        probed = None
        for index, out in enumerate(args.out):
            record_path = out / "view.json"
            scene.render.use_border = False
            scene.cycles.film_exposure, scene.cycles.sample_clamp_indirect = 1, 10
            if record_path.exists():
                record = json.loads(record_path.read_text())
                if record.get("window"):
                    set_window(scene, record["window"])
                render(scene, pathlib.Path(folder) / "warm.exr", 1, 1)  # no time is to include the scene's preparation
            else:
                if not probed:
                    spp = args.reference_spp or sum(args.reference_parts or ())
                    probed = probe(scene, rng, folder, spp, args.least_psnr)
                exposure, small, dropped = probed
                record = {"version": VERSION, "seed": args.seed, "kind": kind, "exposure": exposure}
                record |= {"hdri": builder.hdri, "models": models_used(builder.used), "files": {}}
                if args.frame and not dropped:
                    record |= {"frame": args.frame, "window": choose_window(rng, small, args)}
                    if record["window"]:
                        set_window(scene, record["window"])
                    else:
                        dropped = "flat"
                if dropped:
                    record["dropped"] = dropped
            scene.cycles.film_exposure = record["exposure"]
            # The clamp on indirect light acts before the exposure.
            scene.cycles.sample_clamp_indirect = 10 / record["exposure"]
            view = View(args, index, scene, record)
            if "dropped" not in record:
                view.render_all()
            view.write()


if __name__ == "__main__":
    main()

"""Renders short sequences of frames with motion vectors, and a view that stands still, each frame with its own noise.

blender -b --factory-startup -P training/scenes/sequences.py -- --out SEQUENCES [--only camera ...]

The scenes are layouts of test_scenes.py, which no training uses, and Blender's default scene on a floor. A frame has
HRLS of 1 spp (hrls-FRAME.exr, with layers and the Vector pass), an ordinary small render of 16 spp (lrhs-FRAME.exr) and
a reference of the colour (reference-FRAME.exr); all frames of the still view share one reference. Another run goes on
with the files that are missing. SEQUENCES/NAME/sequence.json is written when a sequence is whole.
"""

import argparse
import contextlib
import json
import math
import pathlib
import random
import sys
import tempfile

import bpy
import numpy
from mathutils import Vector

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import build
import furniture
import render
import shapes
import test_scenes

CATALOGUE = "/usr/share/sweethome3d/furniture/Scopia.sh3f"
SCALE, LRHS_SPP, HRLS_SPP = 4, 16, 1
PLAIN_SPP = HRLS_SPP + LRHS_SPP // SCALE**2  # a plain render of as many samples
LAYERS = render.LAYER_SETS["light"]


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--only", choices=SEQUENCES, nargs="+", default=list(SEQUENCES))
    parser.add_argument("--catalogue", default=CATALOGUE)
    parser.add_argument("--frames", type=int, default=16, help="frames of each sequence that moves")
    parser.add_argument("--still-frames", type=int, default=64)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--reference-spp", type=int, default=128, help="samples of each of a frame's two references")
    parser.add_argument("--threads", type=int, default=2)
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1 :])


def filter_offset(rng):
    """Draws an offset in pixels from Cycles's pixel filter, the Blackman-Harris window of 1.5 pixels."""
    while True:
        at = rng.random()
        window = 0.35875 - sum(
            sign * weight * math.cos(2 * math.pi * i * at)
            for i, (sign, weight) in enumerate(((1, 0.48829), (-1, 0.14128), (1, 0.01168)), 1)
        )
        if rng.random() < window:
            return 1.5 * (at - 0.5)


@contextlib.contextmanager
def jittered(scene, rng):
    """Shifts the camera within the pixel, as engines do: Cycles's first sample is always at the pixel's centre."""
    camera, size = scene.camera.data, max(scene.render.resolution_x, scene.render.resolution_y)
    camera.shift_x, camera.shift_y = (filter_offset(rng) / size for _ in range(2))
    yield
    camera.shift_x = camera.shift_y = 0


def moves(moved, frames, shift, turn=0.0):
    """Moves an object by `shift` in metres and `turn` radians about the vertical a frame, from frame 1 on."""
    location, rotation = moved.location.copy(), moved.rotation_euler.copy()
    for frame in (0, frames + 1):
        moved.location = location + (frame - 1) * Vector(shift)
        moved.rotation_euler[2] = rotation[2] + (frame - 1) * turn
        moved.keyframe_insert("location", frame=frame)
        moved.keyframe_insert("rotation_euler", frame=frame)
    for curve in moved.animation_data.action.fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


def default_scene(builder):
    """Makes a cube, a lamp and a camera as Blender's default scene has them, and a floor below."""
    bpy.ops.mesh.primitive_cube_add(size=2)
    builder.movable.append(bpy.context.object)
    bpy.ops.mesh.primitive_plane_add(size=40, location=(0, 0, -1))
    bpy.ops.object.light_add(type="POINT", location=(4.076, 1.005, 5.904))
    bpy.context.object.data.energy = 1000
    bpy.ops.object.camera_add(location=(7.359, -6.926, 4.958), rotation=(1.1093, 0, 0.8149))
    scene = bpy.context.scene
    scene.camera = bpy.context.object
    scene.world = bpy.data.worlds.new("World")
    scene.world.color = (0.05, 0.05, 0.05)
    return 1.0


def moving_camera(builder, frames, extent_m):
    camera = bpy.context.scene.camera
    right = camera.matrix_world.to_3x3() @ Vector((1, 0, 0))
    moves(camera, frames, 0.016 * extent_m * right, 0.003)


def moving_objects(builder, frames, extent_m):
    """Slides the model that is nearest to the camera, and turns the next two."""
    eye = bpy.context.scene.camera.location
    near = sorted(builder.movable, key=lambda moved: (moved.location - eye).length)
    moves(near[0], frames, (0.02 * extent_m, 0, 0))
    for moved, turn in zip(near[1:3], (0.08, -0.12)):
        moves(moved, frames, (0, 0, 0), turn)


def moving_lamp(builder, frames, extent_m):
    lamps = [o for o in bpy.context.scene.objects if o.type == "LIGHT"]
    strongest = max(lamps, key=lambda lamp: lamp.data.energy)
    moves(strongest, frames, (0.06 * extent_m, 0, 0))


def moving_cube(builder, frames, extent_m):
    moves(builder.movable[0], frames, (0.1, 0, 0))


def still(builder, frames, extent_m):
    pass


# A sequence is (kind of scene, seed, what moves).
SEQUENCES = {
    "camera": ("gallery", 101, moving_camera),
    "objects": ("counter", 102, moving_objects),
    "lamp": ("workshop", 103, moving_lamp),
    "mirror": ("washroom", 104, moving_camera),
    "shadow": ("default", 106, moving_cube),
    "still": ("library", 105, still),
}
KINDS = test_scenes.KINDS | {"default": default_scene}


def set_up(args, name, folder):
    """Builds the scene of a sequence; returns (scene, number of frames)."""
    kind, seed, move = SEQUENCES[name]
    rng = random.Random(seed)
    random.seed(seed)
    numpy.random.seed(seed)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    shapes.enable_add_ons()
    models, textures = furniture.read_catalogue(args.catalogue), furniture.read_textures(args.catalogue)
    builder = build.Builder(rng, models, textures, folder)
    extent_m = KINDS[kind](builder)
    scene = render.set_up(args)
    scene.camera.data.dof.use_dof = False
    exposure = render.probe(scene, rng, folder, 0, 0)[0]
    scene.cycles.film_exposure, scene.cycles.sample_clamp_indirect = exposure, 10 / exposure
    # Data that persists keeps the motion of the frame before.
    scene.render.use_persistent_data = False
    frames = args.still_frames if move is still else args.frames
    move(builder, frames, extent_m)
    return scene, frames


def render_sequence(args, name, folder):
    out = args.out / name
    if (out / "sequence.json").exists():
        return
    out.mkdir(parents=True, exist_ok=True)
    scene, frames = set_up(args, name, folder)
    moving = SEQUENCES[name][2] is not still
    for frame in range(1, frames + 1):
        scene.frame_set(frame)
        seed = SEQUENCES[name][1] * 100000 + 10 * frame

        def renders(kind, spp, offset):
            path = out / f"{kind}-{frame:04}.exr"
            if not path.exists():
                render.render(scene, path, spp, seed + offset)

        render.choose_layers(scene, LAYERS)
        scene.view_layers[0].use_pass_vector = True
        with jittered(scene, random.Random(seed)):
            renders("hrls", HRLS_SPP, 0)
            scene.view_layers[0].use_pass_vector = False
            renders("plain", PLAIN_SPP, 4)
        render.choose_layers(scene, ())
        with render.smaller(scene, SCALE, nearest=False):
            renders("lrhs", LRHS_SPP, 1)
        if moving or frame == 1:
            for part, offset in (("a", 2), ("b", 3)):
                renders(f"reference-{part}", args.reference_spp if moving else 2 * args.reference_spp, offset)
    record = {"kind": SEQUENCES[name][0], "seed": SEQUENCES[name][1], "frames": frames, "moving": moving}
    record |= {"scale": SCALE, "lrhs_spp": LRHS_SPP, "hrls_spp": HRLS_SPP}
    (out / "sequence.json").write_text(json.dumps(record, indent=1) + "\n")


def main():
    args = parse()
    args.frame, args.width, args.height, args.depth = 0, args.size, args.size, "16"
    for name in args.only:
        with tempfile.TemporaryDirectory() as folder:
            render_sequence(args, name, folder)


if __name__ == "__main__":
    main()

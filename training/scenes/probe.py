#!/usr/bin/python3
"""Imports and renders every model of the catalogues on its own and adds those that cannot be used to skip.json.

training/scenes/probe.py CATALOGUE.sh3f ...

The models of one Blender process are a batch; where one crashes it, the model is tried again alone, and the rest go on.
Entries of skip.json stay there, as the scenes of seeds depend on them. A model whose texture is missing is usable:
materials.refinish removes the texture.
"""

import json
import pathlib
import random
import subprocess
import sys
import tempfile

CRASHED, TOO_LONG = "crashes Blender", "takes too long"
HERE = pathlib.Path(__file__).parent


def probe(model, folder):
    """Returns why the model cannot be used, or None."""
    import bpy
    import numpy

    import materials

    bpy.ops.wm.read_factory_settings(use_empty=True)
    try:
        root = model.load(folder)
    except (RuntimeError, ValueError) as error:
        return str(error).strip()
    for part in root.children:
        corners = numpy.empty(3 * len(part.data.vertices))
        part.data.vertices.foreach_get("co", corners)
        if not numpy.isfinite(corners).all():
            return "coordinates that are not finite"
    materials.refinish(root.children, random.Random(0))
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    scene.camera.location = (0, 0, 10)
    bpy.ops.render.render()
    return None


def work(catalogue, results, first, count):
    """Runs inside Blender; writes a line for each model before it is tried, and one with the outcome after."""
    import furniture

    models = furniture.read_catalogue(catalogue)[first : first + count]
    with tempfile.TemporaryDirectory() as folder, open(results, "w", buffering=1) as lines:
        for model in models:
            lines.write(json.dumps({"path": model.path}) + "\n")
            lines.write(json.dumps({"path": model.path, "why": probe(model, folder)}) + "\n")


def batch(catalogue, folder, first, count):
    """Returns [(path, why or None)] of the models that were tried; the last may have crashed Blender."""
    results = pathlib.Path(folder) / "results"
    results.write_text("")
    command = ["blender", "-b", "--factory-startup", "--python-exit-code", "9", "-P", __file__, "--"]
    command += [catalogue, str(results), str(first), str(count)]
    try:
        run = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=30 + 10 * count)
        if run.returncode == 9:
            sys.exit(run.stdout.decode(errors="replace")[-2000:])
        end = CRASHED
    except subprocess.TimeoutExpired:
        end = TOO_LONG
    lines = [json.loads(line) for line in results.read_text().splitlines()]
    outcomes = [(line["path"], line["why"]) for line in lines if "why" in line]
    if lines and "why" not in lines[-1]:
        outcomes.append((lines[-1]["path"], end))
    return outcomes


def main(catalogues):
    skip = json.loads((HERE / "skip.json").read_text())
    with tempfile.TemporaryDirectory() as folder:
        for catalogue in catalogues:
            name, first = pathlib.Path(catalogue).name, 0
            while outcomes := batch(catalogue, folder, first, 50):
                if outcomes[-1][1] in (CRASHED, TOO_LONG):
                    outcomes[-1] = batch(catalogue, folder, first + len(outcomes) - 1, 1)[0]
                first += len(outcomes)
                found = {path: why for path, why in outcomes if why}
                if found:
                    skip[name] = found | skip.get(name, {})
            print(name, first, "models tried,", len(skip.get(name, {})), "to skip", flush=True)
    (HERE / "skip.json").write_text(json.dumps(skip, indent=1) + "\n")


if "--" in sys.argv:
    sys.path.insert(0, str(HERE))
    catalogue, results, first, count = sys.argv[sys.argv.index("--") + 1 :]
    work(catalogue, results, int(first), int(count))
else:
    main(sys.argv[1:])

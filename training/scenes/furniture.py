"""Reads models of Sweet Home 3D catalogues (.sh3f: a zip of OBJ, MTL and textures)."""

import json
import pathlib
import zipfile

import bpy
from mathutils import Matrix, Vector

import shapes

# SKIP is {catalogue file name: {model path: why}}; probe.py writes it.
SKIP = json.loads(pathlib.Path(__file__).with_name("skip.json").read_text())
LEFT_OUT_CATEGORIES = ("Doors and windows", "Doors", "Windows", "Staircases")


class Model:
    """Holds one catalogue entry; size_m is (width, depth, height)."""

    def __init__(self, archive, entry, about):
        self.archive = archive
        self.path = entry["model"].lstrip("/")
        self.name = pathlib.PurePosixPath(self.path).stem
        self.category = entry.get("category", "")
        self.credit = {"catalogue": pathlib.Path(archive).name, "path": self.path} | about
        if "creator" in entry:
            self.credit["creator"] = entry["creator"]
        self.size_m = Vector([float(entry[k]) / 100 for k in ("width", "depth", "height")])
        self.hangs = float(entry.get("elevation", 0)) > 50
        self.importable = (
            self.category not in LEFT_OUT_CATEGORIES
            and "modelRotation" not in entry
            and self.path.lower().endswith(".obj")
            and max(self.size_m) < 4
        )

    def load(self, folder):
        """Imports the model, standing on the origin with its front to -y, at its catalogue size."""
        print("loading", self.path, flush=True)  # names the culprit when the importer crashes
        prefix = str(pathlib.PurePosixPath(self.path).parent) + "/"
        with zipfile.ZipFile(self.archive) as archive:
            archive.extractall(folder, [n for n in archive.namelist() if n.startswith(prefix)])
        bpy.ops.object.select_all(action="DESELECT")
        # Some models hold degenerate faces, which crash Blender unless removed.
        bpy.ops.wm.obj_import(filepath=str(pathlib.Path(folder) / self.path), validate_meshes=True)
        parts = [o for o in bpy.context.selected_objects if o.type == "MESH"]
        if not any(o.data.polygons for o in parts):
            raise ValueError(f"no mesh in {self.path}")
        for layer in (layer for o in parts for layer in o.data.uv_layers):
            for corner in layer.data:
                if max(map(abs, corner.uv)) > 1e4:
                    corner.uv = (0, 0)  # Cycles' texture lookup overflows
        return fit(parts, self.size_m)


def fit(parts, size_m):
    low, high, base = shapes.bounds(parts)
    scale = [size_m[i] / max(high[i] - low[i], 1e-4) for i in range(3)]
    fitted = Matrix.Diagonal((*scale, 1)) @ Matrix.Translation(-base)
    root = bpy.data.objects.new("model", None)
    bpy.context.collection.objects.link(root)
    for part in parts:
        part.matrix_world = fitted @ part.matrix_world
        part.parent = root
    return root


def read_catalogue(archive_path):
    """Returns the models that can be imported, among them those that probe.py found to be unusable."""
    with zipfile.ZipFile(archive_path) as archive:
        text = archive.read("PluginFurnitureCatalog.properties").decode("latin-1")
    entries, about = {}, {}
    for line in text.splitlines():
        key, _, value = line.partition("=")
        name, _, index = key.partition("#")
        if index and not line.startswith("#"):
            entries.setdefault(index, {})[name] = value.strip()
        elif key in ("license", "provider"):
            about[key] = value.strip()
    models = [Model(archive_path, e, about) for e in entries.values() if "model" in e]
    return [m for m in models if m.importable]


def is_skipped(model):
    return model.path in SKIP.get(pathlib.Path(model.archive).name, {})


def read_textures(archive_path):
    """Returns (archive, member) of the photographs large enough to cover a floor or a wall."""
    with zipfile.ZipFile(archive_path) as archive:
        return [
            (archive_path, i.filename)
            for i in archive.infolist()
            if i.filename.lower().endswith((".jpg", ".jpeg")) and i.file_size > 15000
        ]

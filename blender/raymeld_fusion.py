"""Renders the scene twice with Cycles, small with many samples and full-size with few, and has raymeld fuse both.

Or it renders one of them, and has raymeld denoise the full-size one or upscale the small one. It does so for a frame or
for an animation, whose frames are joined in time.

This add-on for Blender 3.4 and newer is installed with Preferences > Add-ons > Install. It runs the program raymeld,
whose path is in the add-on's preferences; without a path there, PATH is searched. The operators are Render > Render
with Raymeld and Render > Render Animation with Raymeld, and the settings are in the render properties.
"""

import contextlib
import os
import random
import shutil
import subprocess
import tempfile

import bpy

bl_info = {
    "name": "Raymeld",
    "description": "Fuses two cheap renders into a good one",
    "blender": (3, 4, 0),
    "category": "Render",
    "location": "Render > Render with Raymeld",
}

# The networks read these passes of the full-size render beside its colour and denoising passes.
PASSES = ("diffuse_direct", "diffuse_indirect", "diffuse_color", "glossy_direct", "glossy_indirect", "glossy_color")


class Failure(Exception):
    """Holds the message that the user is shown."""


class RaymeldPreferences(bpy.types.AddonPreferences):
    bl_idname = __name__

    program: bpy.props.StringProperty(
        name="Program", subtype="FILE_PATH", description="Path of the program raymeld. Empty: PATH is searched"
    )

    def draw(self, _context):
        self.layout.prop(self, "program")


class RaymeldSettings(bpy.types.PropertyGroup):
    command: bpy.props.EnumProperty(
        name="Renders",
        description="What is rendered and given to raymeld",
        items=[
            ("fuse", "Both", "Fuses a small render and a full-size one"),
            ("denoise", "Full Size", "Denoises a full-size render"),
            ("upscale", "Small", "Upscales a small render, by 2x or 4x"),
        ],
        default="fuse",
    )
    scale: bpy.props.EnumProperty(
        name="Scale",
        description="How many times smaller the small render is, in each direction",
        items=[(s, s + "x", "") for s in ("2", "4", "8")],
        default="2",
    )
    few: bpy.props.IntProperty(name="Full-size Samples", min=1, default=3)
    many: bpy.props.IntProperty(
        name="Small Samples", min=0, default=0, description="0: one for each full-size pixel, such as 4 at 2x"
    )
    quality: bpy.props.EnumProperty(
        name="Quality",
        description="Network that is used: the better ones are slower",
        items=[(q, q.title(), "") for q in ("fast", "balanced", "high")],
        default="balanced",
    )
    temporal: bpy.props.BoolProperty(
        name="Join Frames",
        default=True,
        description="Joins each frame of an animation with the ones before it, by its motion vectors",
    )
    folder: bpy.props.StringProperty(
        name="Keep in",
        subtype="DIR_PATH",
        description="Folder that keeps the renders and the result. Empty: the files are deleted; an animation needs it",
    )


def curves_of(thing):
    """Returns all curves that animate an object: keyframes and drivers."""
    animation = thing.animation_data
    if not animation:
        return []
    curves, action = list(animation.drivers), animation.action
    if hasattr(action, "fcurves"):
        curves += action.fcurves
    elif action:  # Blender 5 keeps the curves in slots
        bags = [strip.channelbag(animation.action_slot) for layer in action.layers for strip in layer.strips]
        curves += [curve for bag in bags if bag for curve in bag.fcurves]
    return curves


def path_of(thing, name):
    """Returns the property's path as curves name it, or None if it cannot be animated."""
    try:
        return thing.path_from_id(name)
    except ValueError:
        return None


@contextlib.contextmanager
def changed(pairs):
    """Sets each (object, attribute, value), and sets all of them back at the end.

    The order is the given one, as a file format decides which depths there are. Curves are muted meanwhile, as a render
    would put animated values back.
    """
    animated = [
        curve
        for thing, name, _ in pairs
        if thing.id_data
        for curve in curves_of(thing.id_data)
        if curve.data_path == path_of(thing, name)
    ]
    before = [(curve, "mute", curve.mute) for curve in animated]
    before += [(thing, name, getattr(thing, name)) for thing, name, _ in pairs]
    try:
        for curve in animated:
            curve.mute = True
        for thing, name, value in pairs:
            setattr(thing, name, value)
        yield
    finally:
        for thing, name, value in before:
            setattr(thing, name, value)


def size_of(render):
    return tuple(n * render.resolution_percentage // 100 for n in (render.resolution_x, render.resolution_y))


def small_render(scene, scale):
    """Returns what to set for a render of the same view at 1 / scale of the size."""
    render = scene.render
    width, height = size_of(render)
    if width % scale or height % scale:
        raise Failure(f"the render of {width} x {height} pixels is not a multiple of the scale, {scale}")
    return [
        (render, "resolution_percentage", 100),
        (render, "resolution_x", width // scale),
        (render, "resolution_y", height // scale),
    ]


def plain_render(scene, layer):
    """Returns what to set so that one layer is written as Cycles gives it, in OpenEXR."""
    render, image, cycles = scene.render, scene.render.image_settings, scene.cycles
    # The media type, which Blender 5 added, decides which file formats there are.
    media = [(image, "media_type", "MULTI_LAYER_IMAGE")] if hasattr(image, "media_type") else []
    return media + [
        (render, "use_compositing", False),
        (render, "use_sequencer", False),
        (render, "use_single_layer", True),
        (render, "use_border", False),
        (render, "use_multiview", False),
        (render, "use_file_extension", False),
        (image, "file_format", "OPEN_EXR_MULTILAYER"),
        (image, "color_depth", "32"),
        (image, "exr_codec", "ZIP"),
        (cycles, "use_adaptive_sampling", False),
        (cycles, "use_denoising", False),
        (layer.cycles, "denoising_store_passes", False),
    ]


def render_to(path, scene, samples, seed):
    with contextlib.suppress(FileNotFoundError):
        os.remove(path)  # an earlier run may have left the file
    with changed([(scene.render, "filepath", path), (scene.cycles, "samples", samples), (scene.cycles, "seed", seed)]):
        if "FINISHED" not in bpy.ops.render.render(write_still=True) or not os.path.exists(path):
            raise Failure("Blender did not render")


def program_path(context):
    addon = context.preferences.addons.get(__name__)
    asked = bpy.path.abspath(addon.preferences.program) if addon else ""
    program = shutil.which(asked or "raymeld")
    if not program:
        raise Failure(f"there is no program {asked or 'raymeld in PATH'}: see the add-on's preferences")
    return program


def run_program(program, renders, output, settings, more=()):
    """Gives raymeld the renders, paths by the name of their options, and returns the path of the result."""
    command = [program, settings.command, "-o", output, "--quality", settings.quality, *more]
    for option, path in renders.items():
        command += [option, path]
    if "--lrhs" in renders:
        command += ["--lrhs-sampling", "centered"]
    if settings.command == "upscale":
        command += ["--scale", settings.scale]
    result = subprocess.run(command, capture_output=True, text=True, errors="replace")
    if result.returncode != 0:
        raise Failure(result.stderr.strip().rsplit("\n", 1)[-1] or f"raymeld ended with status {result.returncode}")
    return output


def load(path):
    """Loads the file as the image Raymeld, in place of the last one."""
    last = bpy.data.images.get("Raymeld")
    image = bpy.data.images.load(path)
    image.pack()  # the file may be deleted
    if last:
        last.user_remap(image)
        bpy.data.images.remove(last)
    image.name = "Raymeld"
    return image


def jitter(scene, frame):
    """Returns what to set so that the camera is moved within the pixel, as far as Cycles's pixel filter reaches.

    Cycles takes the first sample in the middle of each pixel, so that frames of one sample add up to jagged edges.
    """
    camera, (width, height) = scene.camera.data, size_of(scene.render)
    size = {"HORIZONTAL": width, "VERTICAL": height}.get(camera.sensor_fit, max(width, height))
    rng = random.Random(frame)
    offsets = [sum(rng.random() - 0.5 for _ in range(4)) * scene.cycles.filter_width / 4 for _ in range(2)]
    return [(camera, f"shift_{axis}", getattr(camera, f"shift_{axis}") + offsets[i] / size)
            for i, axis in enumerate("xy")]


def render_inputs(scene, layer, folder, frame=None, temporal=False):
    """Renders what raymeld reads of the current frame, of an animation if its number is given.

    Returns the paths by the name of raymeld's options.
    """
    settings, scale = scene.raymeld, int(scene.raymeld.scale)
    seed = scene.cycles.seed + 2 * (frame or 0)
    number = "" if frame is None else f".{frame:04}"
    renders = {}
    with changed(plain_render(scene, layer)):
        if settings.command != "denoise":
            renders["--lrhs"] = os.path.join(folder, f"lrhs{number}.exr")
            with changed(small_render(scene, scale)):
                render_to(renders["--lrhs"], scene, settings.many or scale**2, seed + 1)
        if settings.command != "upscale":
            renders["--hrls"] = os.path.join(folder, f"hrls{number}.exr")
            passes = [(layer, "use_pass_" + name, True) for name in (*PASSES, *(["vector"] if temporal else []))]
            if temporal:  # data that persists would keep the motion of the frame before
                passes.append((scene.render, "use_persistent_data", False))
                passes += jitter(scene, frame) if settings.few == 1 else []
            with changed(passes + [(layer.cycles, "denoising_store_passes", True)]):
                render_to(renders["--hrls"], scene, settings.few, seed)
    return renders


def check_scene(scene):
    if scene.render.engine != "CYCLES":
        raise Failure("the render engine is not Cycles")
    if not scene.camera:
        raise Failure("the scene has no camera")
    if scene.raymeld.command != "denoise":
        small_render(scene, int(scene.raymeld.scale))


def run(context):
    scene, settings = context.scene, context.scene.raymeld
    check_scene(scene)
    program = program_path(context)
    with contextlib.ExitStack() as stack:
        if settings.folder:
            folder = bpy.path.abspath(settings.folder)
            os.makedirs(folder, exist_ok=True)
        else:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="raymeld-"))
        renders = render_inputs(scene, context.view_layer, folder)
        return load(run_program(program, renders, os.path.join(folder, "raymeld.exr"), settings))


def run_animation(context):
    """Returns the number of frames."""
    scene, settings = context.scene, context.scene.raymeld
    check_scene(scene)
    program = program_path(context)
    if not settings.folder:
        raise Failure("an animation needs a folder, Keep in, for its frames")
    temporal = settings.temporal and settings.command != "upscale"
    if temporal and scene.render.use_motion_blur:
        raise Failure("Cycles gives no motion vectors with Motion Blur: switch that or Join Frames off")
    if temporal and scene.frame_step != 1:
        raise Failure("motion vectors lead from each frame to the last one: set Step to 1, or switch Join Frames off")
    if scene.frame_start < 0:
        raise Failure(f"raymeld numbers frames from 0 on, and the first one is {scene.frame_start}")
    folder, before = bpy.path.abspath(settings.folder), (scene.frame_current, scene.frame_subframe)
    os.makedirs(folder, exist_ok=True)
    frames = range(scene.frame_start, scene.frame_end + 1, scene.frame_step)
    try:
        for frame in frames:
            scene.frame_set(frame)
            renders = render_inputs(scene, context.view_layer, folder, frame, temporal)
    finally:
        scene.frame_set(before[0], subframe=before[1])
    patterns = {option: os.path.join(folder, option.lstrip("-") + ".####.exr") for option in renders}
    more = ["--frames", f"{frames[0]}-{frames[-1]}x{scene.frame_step}", *(["--temporal"] if temporal else [])]
    run_program(program, patterns, os.path.join(folder, "raymeld.####.exr"), settings, more)
    return len(frames)


def attempt(operator, work, context):
    """Returns what `work` returns, or None after an error, which the user is shown."""
    try:
        return work(context)
    except (Failure, OSError, RuntimeError) as failure:
        operator.report({"ERROR"}, str(failure))
        return None


class RENDER_OT_raymeld(bpy.types.Operator):
    """Render the scene cheaply, and make the image Raymeld of it"""

    bl_idname = "render.raymeld"
    bl_label = "Render with Raymeld"

    def execute(self, context):
        image = attempt(self, run, context)
        if image is None:
            return {"CANCELLED"}
        for area in context.screen.areas if context.screen else ():
            if area.type == "IMAGE_EDITOR":
                area.spaces.active.image = image
        self.report({"INFO"}, f"Made {image.size[0]} x {image.size[1]} pixels")
        return {"FINISHED"}


class RENDER_OT_raymeld_animation(bpy.types.Operator):
    """Render the animation cheaply, and write the files raymeld.####.exr"""

    bl_idname = "render.raymeld_animation"
    bl_label = "Render Animation with Raymeld"

    def execute(self, context):
        count = attempt(self, run_animation, context)
        if count is None:
            return {"CANCELLED"}
        self.report({"INFO"}, f"Made {count} frames in {context.scene.raymeld.folder}")
        return {"FINISHED"}


class RENDER_PT_raymeld(bpy.types.Panel):
    bl_label = "Raymeld"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {"CYCLES"}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        self.layout.use_property_split = True
        unused = {"denoise": ("scale", "many"), "upscale": ("few", "temporal")}.get(context.scene.raymeld.command, ())
        for name in ("command", "scale", "few", "many", "quality", "temporal", "folder"):
            if name not in unused:
                self.layout.prop(context.scene.raymeld, name)
        draw_operators(self, context)


CLASSES = (
    RaymeldPreferences,
    RaymeldSettings,
    RENDER_OT_raymeld,
    RENDER_OT_raymeld_animation,
    RENDER_PT_raymeld,
)


def draw_operators(self, _context):
    self.layout.operator(RENDER_OT_raymeld.bl_idname)
    self.layout.operator(RENDER_OT_raymeld_animation.bl_idname)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.raymeld = bpy.props.PointerProperty(type=RaymeldSettings)
    bpy.types.TOPBAR_MT_render.append(draw_operators)


def unregister():
    bpy.types.TOPBAR_MT_render.remove(draw_operators)
    del bpy.types.Scene.raymeld
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)

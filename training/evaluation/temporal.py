#!/usr/bin/python3
"""Measures what frames gain from the ones before them, on the sequences of scenes/sequences.py.

PYTHONPATH=build/release/python:training training/evaluation/temporal.py --sequences SEQUENCES [--model x4-fast]
fuses each frame by itself and with its history, writes bench/quality/temporal.csv and, with --write-docs, the table and
the picture of docs/temporal.md. With --videos FOLDER it also writes a video of each sequence, with HRLS, each frame by
itself, with its history and the reference side by side. A frame has two references, whose noise is independent, so that
it cancels in the mean product of the errors against them.
"""

import argparse
import csv
import json
import math
import pathlib

import numpy
import raymeld
import torch

from evaluation import baselines, filters, images, pictures, tables

ROOT = pathlib.Path(__file__).resolve().parents[2]
LAYERS = ("color", "albedo", "normal", "diffuse", "specular")
SHOWN = (1, 2, 4, 8, 12, 16, 32, 64)  # frames whose PSNR is in the table
SVGF_SHOWN = 8  # the frame for which the filter of a plain render is shown
ALONE = 1  # the frame by itself among the images of measure()
PICTURED = ("camera", "objects")  # sequences of which the picture has a row
SETTLED = 4  # frames after which flicker is measured
YOUNG = 4  # pixels that came into sight within so many frames are young
UNLIKE = 0.15  # distance of albedo or normal from the range of the 3x3 pixels, beyond which a surface is another one
SUMMED = ("flicker", "along", "young")  # as parts of those of frames by themselves
STILL = 0.01  # pixels of motion, below which a pixel stands still
LEAST_STILL = 0.05  # part of the pixels that must stand still for a figure of these
COLUMNS = ("sequence", "model", "frame", "psnr_alone", "psnr", "flicker_alone", "flicker", "along_alone", "along")
COLUMNS += ("young_share", "young_alone", "young", "psnr_svgf", "psnr_svgf_alone", "noise_alone", "noise")


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sequences", required=True, type=pathlib.Path)
    parser.add_argument("--model", default="x4-fast")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "bench/quality/temporal.csv")
    parser.add_argument("--videos", type=pathlib.Path, help="folder for a video of each sequence, as YUV4MPEG2")
    parser.add_argument("--write-docs", action="store_true")
    return parser.parse_args()


def read_motion(path):
    """Reads Cycles's Vector pass, whose y points upwards, as pixels to the right and downwards, and its depth twice.

    So these are the four channels [H, W, 4] that a fusion takes as its motion.
    """
    exr = images.Exr.read(path)
    vector = {exr.channels[i][-1]: exr.pixels[..., i] for i in exr.indices(lambda layer: layer == "Vector")}
    (depth,) = (exr.pixels[..., i] for i in exr.indices(lambda layer: layer == "Denoising Depth"))
    return numpy.stack([vector["X"], -vector["Y"], depth, depth], -1)


def errors_of(image, references):
    """Returns the errors against both references [2, H, W, 3]."""
    return numpy.stack([pictures.srgb(image) - pictures.srgb(reference) for reference in references])


def square(errors):
    """Returns the squared errors [H, W, 3] without the references' noise, which may be negative."""
    return errors[0] * errors[1]


def psnr(errors):
    return -10 * math.log10(square(errors).mean())


def flicker(now, last):
    """Returns the RMS of the errors' change from frame to frame."""
    return math.sqrt(max(square(now - last).mean(), 0))


def flicker_along(now, last, motion):
    """Returns the same of each point that both frames show, wherever it has moved to."""
    past, seen = (numpy.stack(x) for x in zip(*(baselines.reprojected(e, motion, lambda y, x: 1) for e in last)))
    inside = seen[..., None] > 0.999  # all four pixels around a point
    return flicker(numpy.where(inside, now, 0), numpy.where(inside, past, 0))


def noise_of(errors, still):
    """Returns the standard deviation over frames of the errors [N, 2, H, W, 3] in pixels that stand still [H, W]."""
    away = errors - errors.mean(0)
    return math.sqrt(max((away[:, 0] * away[:, 1])[:, still].mean(), 0))


class Ages:
    """Counts for how many frames each pixel's surface has been in sight, by albedo and normal."""

    def __init__(self):
        self.guides = self.ages = None

    def next(self, guides, motion):
        height, width = guides.shape[:2]
        last, ages = self.guides, self.ages
        self.guides = guides
        if last is None:
            self.ages = numpy.full((height, width), 1000)
            return self.ages
        padded = numpy.pad(guides, ((1, 1), (1, 1), (0, 0)), "edge")
        near = [padded[dy : dy + height, dx : dx + width] for dy in range(3) for dx in range(3)]
        low, high = numpy.minimum.reduce(near), numpy.maximum.reduce(near)
        rows, columns = numpy.mgrid[:height, :width]
        x, y = (numpy.rint(at + motion[..., i]).astype(int) for i, at in enumerate((columns, rows)))
        seen = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        x, y = x.clip(0, width - 1), y.clip(0, height - 1)
        away = numpy.maximum(last[y, x] - high, low - last[y, x]).max(-1)
        self.ages = numpy.where(seen & (away < UNLIKE), ages[y, x] + 1, 0)
        return self.ages


def measure(folder, model_name):
    """Returns a row of COLUMNS for each frame of a sequence, and the images of each as 8-bit sRGB.

    These are HRLS, the frame by itself, the frame with its history, SVGF with its temporal part, and the reference.
    """
    record = json.loads((folder / "sequence.json").read_text())
    model = raymeld.Model(model_name)
    size = images.read(folder / "lrhs-0001.exr").shape[:2]
    options = {"sampling": "centered", "lrhs_spp": record["lrhs_spp"], "hrls_spp": record["hrls_spp"]}
    alone = raymeld.Fusion(model, *size, **options)
    joined = raymeld.Fusion(model, *size, temporal=True, motion_depth=True, **options)
    ages, last, rows, strips, settled, still = Ages(), None, [], [], [], numpy.True_
    tuned = filters.TUNED["svgf"][2]
    svgf = baselines.TemporalSvgf(tuned)
    for frame in range(1, record["frames"] + 1):
        path = folder / f"hrls-{frame:04}.exr"
        layers = dict(zip(LAYERS, images.layers(path, LAYERS)))
        lrhs, deep_motion = images.read(folder / f"lrhs-{frame:04}.exr"), read_motion(path)
        motion = deep_motion[..., :2]
        fused = [alone.fuse(lrhs, layers), joined.fuse(lrhs, layers, deep_motion)]
        number = frame if record["moving"] else 1
        references = [images.read(folder / f"reference-{part}-{number:04}.exr") for part in "ab"]
        color, albedo, normal = images.layers(folder / f"plain-{frame:04}.exr", LAYERS[:3])
        filtered = [svgf.next(color, albedo, normal, motion), baselines.svgf(color, albedo, normal, tuned)]
        errors = [errors_of(image, references) for image in fused]
        young = ages.next(numpy.concatenate([layers["albedo"], layers["normal"]], -1), motion) < YOUNG
        changes = [flicker(a, b) for a, b in zip(errors, last)] if last else ["", ""]
        along = [flicker_along(a, b, motion) for a, b in zip(errors, last)] if last else ["", ""]
        of_young = [float(square(error)[young].sum()) for error in errors]
        psnrs = [psnr(error) for error in errors]
        of_svgf = [psnr(errors_of(image, references)) for image in filtered]
        values = (folder.name, model_name, frame, *psnrs, *changes, *along, young.mean(), *of_young, *of_svgf, "", "")
        rows.append(dict(zip(COLUMNS, values)))
        strip = [layers["color"], *fused, filtered[0], (references[0] + references[1]) / 2]
        strips.append([numpy.uint8(pictures.srgb(image) * 255 + 0.5) for image in strip])
        last = errors
        if frame > SETTLED:
            settled.append(errors)
            # What has no normal is the background, which has no motion even where the camera moves.
            still &= (numpy.abs(motion) < STILL).all(-1) & layers["normal"].any(-1)
    if still.mean() >= LEAST_STILL:
        rows[-1] |= {"noise" + by: noise_of(numpy.stack(e), still) for by, e in zip(("_alone", ""), zip(*settled))}
    return rows, strips


def write_video(path, strips):
    """Writes HRLS, both fused images and the reference side by side, at 12 frames a second, by BT.601."""
    luma = numpy.float32((0.299, 0.587, 0.114))
    with path.open("wb") as file:
        for i, strip in enumerate(strips):
            image = numpy.concatenate([strip[0], strip[1], strip[2], strip[4]], axis=1) / numpy.float32(255)
            if i == 0:
                file.write(b"YUV4MPEG2 W%d H%d F12:1 Ip A1:1 C444\n" % (image.shape[1], image.shape[0]))
            y = image @ luma
            planes = 16 + 219 * y, 128 + 224 * (image[..., 2] - y) / 1.772, 128 + 224 * (image[..., 0] - y) / 1.402
            file.write(b"FRAME\n" + b"".join(numpy.uint8(plane + 0.5).tobytes() for plane in planes))


def table(rows):
    frames = [frame for frame in SHOWN if any(row["frame"] == frame for row in rows)]
    head = ["", *(f"frame {frame}" for frame in frames), f"SVGF, frame {SVGF_SHOWN}", "flicker"]
    head += ["flicker along the motion", "newly in sight", "noise in still pixels"]
    lines = []
    for name in dict.fromkeys(row["sequence"] for row in rows):
        by_frame = {row["frame"]: row for row in rows if row["sequence"] == name}
        settled = [row for frame, row in by_frame.items() if frame > SETTLED]
        leads = [
            f"{by_frame[frame]['psnr_alone']:.2f} → {by_frame[frame]['psnr']:.2f}" if frame in by_frame else ""
            for frame in frames
        ]
        sums = [[sum(row[key + by] for row in settled) for by in ("", "_alone")] for key in SUMMED]
        sums.append([by_frame[max(by_frame)][key] or 0 for key in ("noise", "noise_alone")])
        svgf = by_frame[SVGF_SHOWN]
        leads.append(f"{svgf['psnr_svgf_alone']:.2f} → {svgf['psnr_svgf']:.2f}")
        lines.append([name, *leads, *(f"{joined / alone:.2f}" if alone else "" for joined, alone in sums)])
    return tables.Sheet("temporal", head, lines)


def main():
    args = parse()
    torch.set_num_threads(1)
    rows, shown_parts = [], []
    for folder in sorted(path.parent for path in args.sequences.glob("*/sequence.json")):
        more, strips = measure(folder, args.model)
        rows += more
        if folder.name in PICTURED:
            parts = [image / numpy.float32(255) for image in strips[SVGF_SHOWN - 1]]
            shown_parts.append(pictures.worst_crops(parts, ALONE))
        if args.videos:
            args.videos.mkdir(parents=True, exist_ok=True)
            write_video(args.videos / f"{folder.name}.y4m", strips)
        print(table([row for row in rows if row["sequence"] == folder.name]).markdown(), flush=True)
    with args.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({key: f"{x:.6g}" if isinstance(x, float) else x for key, x in row.items()})
    if args.write_docs:
        page = ROOT / "docs/temporal.md"
        page.write_text(tables.insert(page.read_text(), [table(rows)]))
        pictures.pyplot.imsave(ROOT / "docs/temporal.png", numpy.concatenate(shown_parts))


if __name__ == "__main__":
    main()

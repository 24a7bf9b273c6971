#!/usr/bin/python3
"""Renders the public test set, or its first views, one Blender process each; run it again to go on after a stop.

The views show models of Scopia.sh3f in layouts of test_scenes.py; no training uses either. Each view has HRLS of 1 to
8 spp (with layers), plain renders of 16 and 32 spp, ordinary small renders of three scales, decimated ones of as
many, albedo and normal of renders of their own, and the reference.

References take most of the time. Those in data/test, compressed with an error of about 60 dB, are taken from there;
--references renders them anew.
"""

import argparse
import json
import pathlib
import shutil

import generate
import OpenImageIO as oiio

REFERENCES = pathlib.Path(__file__).resolve().parents[2] / "data/test"
CATALOGUE = "/usr/share/sweethome3d/furniture/Scopia.sh3f"
# A view is (kind, seed); any first views of the list are varied.
VIEWS = [
    ("gallery", 1),
    ("courtyard", 2),
    ("counter", 3),
    ("library", 4),
    ("terrace", 5),
    ("shop", 6),
    ("workshop", 7),
    ("washroom", 8),
    ("courtyard", 9),
    ("counter", 10),
    ("gallery", 11),
    ("terrace", 12),
    ("library", 13),
    ("workshop", 14),
    ("shop", 15),
    ("washroom", 16),
]
LOWRES = {2: (4, 8, 16), 4: (4, 8, 16, 32, 64), 8: (64, 128, 256)}
LRHS = {2: (4, 8, 16), 4: (16, 32, 64), 8: (64, 128, 256)}


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--catalogue", default=CATALOGUE)
    parser.add_argument("--views", type=int, default=len(VIEWS), help="number of views, from the first")
    parser.add_argument(
        "--only-scale", type=int, choices=LOWRES, help="render what pairs of that scale need, into a folder of its own"
    )
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--reference-spp", type=int, default=512)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--timeout-s", type=float, default=7200)
    parser.add_argument("--references", action="store_true", help="render only references, into data/test")
    parser.add_argument("--look", action="store_true", help="render only 16 spp, to look at")
    return parser.parse_args()


def keep_reference(folder):
    """Compresses the reference of a view and puts it into REFERENCES with the view's record."""
    kept = REFERENCES / folder.name
    kept.mkdir(parents=True, exist_ok=True)
    for half in ("reference-a.exr", "reference-b.exr"):
        image = oiio.ImageBuf(str(folder / half))
        names = [name for name in image.spec().channelnames if name[:-1].endswith("Combined.") and name[-1] in "RGB"]
        color = oiio.ImageBufAlgo.channels(image, tuple(sorted(names, key=lambda name: "RGB".index(name[-1]))))
        color.set_write_format(oiio.HALF)
        color.specmod().attribute("compression", "dwab:20")
        if not color.write(str(kept / half)):
            raise OSError(f"{kept / half}: {color.geterror()}")
    record = json.loads((folder / "view.json").read_text())
    record.pop("whole")
    for file in record["files"].values():
        file.pop("seconds")  # another machine renders the rest
    (kept / "view.json").write_text(json.dumps(record, indent=1) + "\n")


def take_reference(final):
    """Starts a view with its kept reference, if there is one and the view is not there yet."""
    kept, partial = REFERENCES / final.name, final.with_suffix(".part")
    if kept.exists() and not final.exists() and not partial.exists():
        shutil.copytree(kept, partial)


def main():
    args = parse()
    args.out.mkdir(parents=True, exist_ok=True)
    for kind, seed in VIEWS[: args.views]:
        arguments = ["--kind", kind, "--seed", str(seed), "--catalogue", args.catalogue, "--threads", str(args.threads)]
        arguments += ["--width", str(args.size), "--height", str(args.size)]
        final = args.out / f"view-{seed:05}"
        if args.look:
            arguments += ["--plain-spp", "16"]
        elif args.references:
            arguments += ["--reference-spp", str(args.reference_spp)]
        else:
            take_reference(final)
            arguments += ["--spp", "1", "2", "3", "4", "7", "8"]
            scales = [args.only_scale] if args.only_scale else LOWRES
            for option, counts in (("--lowres", LOWRES), ("--lrhs", LRHS)):
                arguments += [option, *(f"{scale}:{spp}" for scale in scales for spp in counts[scale])]
            if not args.only_scale:
                arguments += ["--plain-spp", "16", "32", "--guides", "2", "4", "8"]
            arguments += ["--reference-spp", str(args.reference_spp)]
        generate.run_view(final, arguments, args.timeout_s)
        if args.references and final.exists():
            keep_reference(final)


main()

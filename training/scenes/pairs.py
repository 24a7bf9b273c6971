#!/usr/bin/python3
"""Renders pairs as users have them, for training: full-size renders of few samples, ordinary small ones of many.

Each seed is a scene, of which --windows views of 192x192 are kept. ../pack.py packs a view as
OUT/view-SEED-WINDOW.safetensors. A scene leaves OUT/view-SEED.done once its views are packed, or .failed with the log's
end if Blender crashed or ran out of time. Run it again to go on after a stop. Every tenth seed is held out: it has all
pairs of samples and a cleaner reference.
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import random
import shutil
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent))
import pack

SCRIPT = pathlib.Path(__file__).with_name("render.py")
FRAMES = (384, 512, 768, 1024)  # sizes of the frames that views are windows of
# These samples of the small render cost as much as 1, 2 and 4 samples at full size.
LOW_SPP = {2: (4, 8, 16), 4: (16, 32, 64), 8: (64, 128, 256)}
GUIDE_SPP = (2, 4, 8)


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--catalogue", required=True, nargs="+")
    parser.add_argument("--seeds", required=True, help="FIRST:LAST, the last excluded")
    parser.add_argument("--kind", help="kind of scene; by default the seed decides")
    parser.add_argument("--windows", type=int, default=2)
    parser.add_argument("--size", type=int, default=192)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout-s", type=float, default=3600)
    return parser.parse_args()


def held_out(seed):
    return seed % 10 == 0


def renders(seed):
    """Returns render.py's arguments for the renders of a seed. Drawing them does not change the scene."""
    rng = random.Random(f"renders {seed}")
    low, guides, reference, least_psnr = LOW_SPP, GUIDE_SPP, (64, 192), 26
    if not held_out(seed):
        low = {scale: rng.sample(spp, 1 if scale == 8 else 2) for scale, spp in LOW_SPP.items()}
        guides, reference, least_psnr = [rng.choice(GUIDE_SPP)], (8, 24), 23
    return [
        *("--frame", rng.choice(FRAMES), "--spp", 1, 2, 4, 8, "--layers", "light"),
        *("--lowres-layers", "--lowres", *(f"{scale}:{spp}" for scale in low for spp in low[scale])),
        *("--guides", *guides, "--reference-parts", *reference, "--least-psnr", least_psnr),
    ]


def run(seed, args):
    stem = args.out / f"view-{seed:05}"
    done, failed, partial = (stem.with_suffix(s) for s in (".done", ".failed", ".part"))
    if done.exists() or failed.exists():
        return
    folders = [partial / str(window) for window in range(args.windows)]
    options = ["--seed", seed, "--width", args.size, "--height", args.size, "--catalogue", *args.catalogue]
    options += ["--kind", args.kind] if args.kind else []
    command = ["blender", "-b", "--factory-startup", "-P", SCRIPT, "--", "--out", *folders, *options, *renders(seed)]
    try:
        ended = subprocess.run(
            list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=args.timeout_s
        )
        log = ended.stdout
    except subprocess.TimeoutExpired as expired:
        log = (expired.stdout or b"") + b"\nout of time"
    records = [json.loads((f / "view.json").read_text()) for f in folders if (f / "view.json").exists()]
    if len(records) == len(folders) and all("dropped" in r or r.get("whole") for r in records):
        for window, (folder, record) in enumerate(zip(folders, records)):
            if record.get("whole"):
                pack.pack(folder, args.out / f"{stem.name}-{window}.safetensors")
        done.write_text(json.dumps([r.get("dropped") for r in records]) + "\n")
    else:
        failed.write_bytes(log[-4000:])
    shutil.rmtree(partial, ignore_errors=True)
    print("failed" if failed.exists() else "done", stem.name, [r.get("dropped", "kept") for r in records], flush=True)


def main():
    args = parse()
    args.out.mkdir(parents=True, exist_ok=True)
    first, last = map(int, args.seeds.split(":"))
    os.nice(19)
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(lambda seed: run(seed, args), range(first, last)))


if __name__ == "__main__":
    main()

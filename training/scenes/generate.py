#!/usr/bin/env python3
"""Renders many seeded views, one Blender process each; run it again to go on after a stop.

A view is whole once its folder has its final name. A view that crashes Blender leaves NAME.failed with the log's end
and costs nothing else; remove that file to try it again.
"""

import argparse
import concurrent.futures
import pathlib
import shutil
import subprocess

SCRIPT = pathlib.Path(__file__).with_name("render.py")


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--catalogue", required=True, nargs="+")
    parser.add_argument("--seeds", required=True, help="FIRST:LAST, the last excluded")
    parser.add_argument("--size", type=int, default=192)
    parser.add_argument("--spp", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--plain-spp", type=int, nargs="+", default=[16, 32, 64])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout-s", type=float, default=600)
    return parser.parse_args()


def view(args, seed):
    final = args.out / f"view-{seed:05}"
    failed = final.with_suffix(".failed")
    if final.exists() or failed.exists():
        return
    partial = final.with_suffix(".part")
    shutil.rmtree(partial, ignore_errors=True)
    command = ["blender", "-b", "--factory-startup", "-P", str(SCRIPT), "--", "--out", str(partial), "--seed", str(seed)]
    command += ["--width", str(args.size), "--height", str(args.size), "--catalogue", *args.catalogue]
    command += ["--spp", *map(str, args.spp), "--plain-spp", *map(str, args.plain_spp)]
    try:
        run = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=args.timeout_s)
        log = run.stdout
    except subprocess.TimeoutExpired as expired:
        log = (expired.stdout or b"") + b"\nout of time"
    if (partial / "view.json").exists():
        partial.rename(final)
        print("rendered", final.name, flush=True)
    else:
        shutil.rmtree(partial, ignore_errors=True)
        failed.write_bytes(log[-4000:])
        print("failed", final.name, flush=True)


def main():
    args = parse()
    args.out.mkdir(parents=True, exist_ok=True)
    first, last = map(int, args.seeds.split(":"))
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(lambda seed: view(args, seed), range(first, last)))


main()

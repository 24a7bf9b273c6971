#!/usr/bin/python3
"""Renders many seeded views, one Blender process each; run it again to go on after a stop.

A view is whole once its folder has its final name. A view that is not worth keeping leaves NAME.dropped, its view.json.
A view that crashes Blender or runs out of time leaves NAME.failed with the log's end. Remove either to try again.
In the end manifest.jsonl lists all views of the folder; to write nothing else, give no seeds, as in 0:0.
"""

import argparse
import concurrent.futures
import json
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
    parser.add_argument("--frame", type=int, help="each view is a window of a frame of this size")
    parser.add_argument("--spp", type=int, nargs="+", default=[1, 2, 4, 8, 16, 32, 64])
    parser.add_argument("--reference-spp", type=int, default=512)
    parser.add_argument("--reference-psnr", type=float, help="noise at which a reference has enough samples, dB")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout-s", type=float, default=1500)
    return parser.parse_args()


def run_view(final, arguments, timeout_s, script=SCRIPT):
    """Renders into `final`, a folder, or leaves .dropped or .failed beside it; does nothing where one of them is."""
    dropped, failed, partial = (final.with_suffix(s) for s in (".dropped", ".failed", ".part"))
    if final.exists() or dropped.exists() or failed.exists():
        return
    command = ["blender", "-b", "--factory-startup", "-P", str(script), "--", "--out", str(partial), *arguments]
    try:
        log = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=timeout_s).stdout
    except subprocess.TimeoutExpired as expired:
        log = (expired.stdout or b"") + b"\nout of time"
    record_path = partial / "view.json"
    record = json.loads(record_path.read_text()) if record_path.exists() else {}
    if record.get("whole"):
        partial.rename(final)
        outcome = "rendered"
    elif "dropped" in record:
        record_path.rename(dropped)
        shutil.rmtree(partial)
        outcome = "dropped"
    else:
        shutil.rmtree(partial, ignore_errors=True)
        failed.write_bytes(log[-4000:])
        outcome = "failed"
    print(outcome, final.name, flush=True)


def write_manifest(folder):
    """Writes manifest.jsonl: what every view is and whose models it shows. The files of dropped views are gone."""
    lines = []
    for path in sorted([*folder.glob("view-*[0-9]/view.json"), *folder.glob("view-*.dropped")]):
        record = json.loads(path.read_text())
        record["spp"] = {name: file["spp"] for name, file in record.pop("files").items()}
        record.pop("whole", None)
        lines.append(json.dumps(record) + "\n")
    (folder / "manifest.jsonl").write_text("".join(lines))


def main():
    args = parse()
    args.out.mkdir(parents=True, exist_ok=True)
    first, last = map(int, args.seeds.split(":"))
    common = ["--width", str(args.size), "--height", str(args.size), "--catalogue", *args.catalogue]
    common += ["--spp", *map(str, args.spp), "--reference-spp", str(args.reference_spp)]
    if args.frame:
        common += ["--frame", str(args.frame)]
    if args.reference_psnr:
        common += ["--reference-psnr", str(args.reference_psnr)]

    def view(seed):
        run_view(args.out / f"view-{seed:05}", ["--seed", str(seed), *common], args.timeout_s)

    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(view, range(first, last)))
    write_manifest(args.out)


if __name__ == "__main__":
    main()

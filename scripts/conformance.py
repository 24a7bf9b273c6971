#!/usr/bin/env python3
"""Sums up what raymeld conform --json found on several devices; --markdown prints docs/conformance-report.md."""
import json
import subprocess
import sys
from pathlib import Path


def key(row):
    return row["layer"], row["kernel"], row["precision"]


def cell(row):
    if row is None:
        return "-"
    if row["verdict"] == "unsupported":
        return f"no {row['missing']}" if not row["layer"].startswith("agreement") else "-"
    ratio = row["worst"]["ratio"]
    text = ratio if isinstance(ratio, str) else f"{ratio:.3g}"
    return f"**FAILED {text}**" if row["failed"] else text


def largest(rows):
    """Returns the row whose worst value is nearest to its bound, or furthest beyond it."""
    tried = [row for row in rows if row and "worst" in row]
    if not tried:
        return None
    return max(tried, key=lambda row: float("inf") if isinstance(row["worst"]["ratio"], str) else row["worst"]["ratio"])


def place(row):
    worst = row and row["worst"]
    if not worst or worst["ratio"] == 0:
        return ""
    what = ", ".join(text for text in (worst["comparison"], worst["case"]) if text)
    return f"{what}; c {worst['c']}, y {worst['y']}, x {worst['x']}"


def summary(name, report):
    missing = sorted({row["missing"] for row in report["rows"] if "missing" in row})
    text = f"{name}: {report['device']}, {report['driver'].strip()}: {report['passed']} cases passed, " \
           f"{report['failed']} failed, {report['unsupported']} unsupported"
    return text + (f" ({', '.join(missing)})" if missing else "")


def agreement(report):
    """Returns, by the device that networks were compared with: (outputs that passed, that failed, the worst row)."""
    found = {}
    for row in report["rows"]:
        if row["layer"].startswith("agreement with ") and "worst" in row:
            found.setdefault(row["layer"].removeprefix("agreement with "), []).append(row)
    return {other: (sum(row["passed"] for row in rows), sum(row["failed"] for row in rows), largest(rows))
            for other, rows in found.items()}


def print_text(reports):
    for name, report in reports.items():
        print(summary(name, report))
        for other, (passed, failed, worst) in agreement(report).items():
            print(f"  agrees with {other} in {passed} of {passed + failed} outputs of networks; "
                  f"difference / both bounds: {cell(worst)}")
        for failure in report["failures"]:
            print("  FAILED "
                  + ", ".join(failure[part] for part in ("layer", "kernel", "precision", "case", "message")))


def current_commit():
    """Returns the short name of the commit that is checked out beside this script."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def print_markdown(reports, commit):
    names = list(reports)
    print("# Conformance report\n")
    print(f"`scripts/test-drivers --full --write-docs` wrote this page at commit {commit}.\n"
          "[conformance.md](conformance.md) says how to read it.\n")
    print("| driver | device | version | Vulkan | passed | failed | unsupported |\n|---|---|---|---|---|---|---|")
    for name, r in reports.items():
        print(f"| {name} | {r['device']} | {r['driver'].strip()} | {r['api_version']} | {r['passed']} | "
              f"{r['failed']} | {r['unsupported']} |")
    print("\n## Outputs of networks: one driver against another\n")
    print("| driver | other driver | outputs that agree | difference / sum of both bounds | where |")
    print("|---" * 5 + "|")
    for name, report in reports.items():
        for other, (passed, failed, worst) in agreement(report).items():
            print(f"| {name} | {other} | {passed} of {passed + failed} | {cell(worst)} | {worst['kernel']}, "
                  f"{worst['precision']}, {place(worst)} |")
    print("\n## Layers and networks against the reference: worst error / bound\n")
    print("A cell is the worst of all cases, and up to 1 is right. `no ...` names the feature that the driver lacks;\n"
          "with `-` the driver has no such cases.\n")
    print("| layer | kernel | precision | " + " | ".join(names) + " | where the largest is |")
    print("|---" * (len(names) + 4) + "|")
    tables = [{key(row): row for row in report["rows"]} for report in reports.values()]
    for one in dict.fromkeys(row for table in tables for row in table):
        if one[0].startswith("agreement"):
            continue
        rows = [table.get(one) for table in tables]
        print("| " + " | ".join([*one, *map(cell, rows), place(largest(rows))]) + " |")
    for name, report in reports.items():
        for failure in report["failures"]:
            print(f"\n{name} FAILED "
                  + ", ".join(failure[p] for p in ("layer", "kernel", "precision", "case", "message")))


if __name__ == "__main__":
    files = [Path(argument) for argument in sys.argv[1:] if argument != "--markdown"]
    read = {file.stem: json.loads(file.read_text()) for file in files}
    if "--markdown" in sys.argv:
        print_markdown(read, current_commit())
    else:
        print_text(read)

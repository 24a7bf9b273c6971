#!/usr/bin/env python3
"""Writes the tables of docs/trade.md from the trade.json that raymeld trade made: trade.py TRADE.json PAGE.md"""
import json
import re
import sys
from pathlib import Path

from page import insert, markdown


def setting_name(setting):
    return ", ".join([setting["precision"]] + (["direct kernels"] if setting["kernels"] == "direct" else []))


def settings(trade):
    rows = []
    plain = {}
    for s in trade["settings"]:
        time = s["time_ms"]["median"]
        plain.setdefault(s["model"], (time, s["psnr_db"]))
        own_time, own_psnr = plain[s["model"]]
        rows.append([s["model"], setting_name(s), f"{time:.0f}", f"{time / own_time:.2f}",
                     f"{s['memory_bytes'] / 2**20:.0f}", f"{s['psnr_db']:.3f}", f"{s['psnr_db'] - own_psnr:+.3f}",
                     f"{s['relmse']:.5f}", f"{s['fp64_error']:.2g}",
                     " ".join(name for name in ("time", "memory") if s[name + "_front"])])
    return markdown(["model", "setting", "ms", "to the first", "MiB", "PSNR", "to the first", "RelMSE",
                     "error, steps", "on the front of"], rows)


def renders(trade):
    rows = []
    shown = [r for r in trade["renders"] if r["front"] or not r["model"]]
    for r in sorted(shown, key=lambda r: r["render_s"] + r["fuse_s"]):
        samples = f"{r['lrhs_spp']}-{r['hrls_spp']}" if r["model"] else f"{r['hrls_spp']}"
        rows.append([r["model"] or "plain render", samples, f"{r['render_s']:.2f}", f"{r['fuse_s']:.2f}",
                     f"{r['render_s'] + r['fuse_s']:.2f}", f"{r['psnr_db']:.2f}", f"{r['relmse']:.4f}"])
    return markdown(["", "samples", "render s", "fuse s", "together", "PSNR", "RelMSE"], rows)


def main():
    trade, page = json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2])
    text = page.read_text()
    tables = {"settings": settings, "renders": renders}
    for name, table in tables.items():
        text = insert(text, name, table(trade), page)
    where = f"{trade['device']}, {trade['driver'].strip()}"
    text = re.sub(r"(<!-- begin device -->).*?(<!-- end -->)", lambda match: match[1] + where + match[2], text)
    page.write_text(text)


if __name__ == "__main__":
    main()

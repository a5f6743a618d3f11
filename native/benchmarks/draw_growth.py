"""Draws how the time of a map grows with its points, against N log N.

draw_growth.py RECORDS PICTURE
"""

from __future__ import annotations

import json
import statistics
import sys
from pathlib import Path

import matplotlib
import numpy as np
from build_tools.benchmarks import SIZES

WIDTH = 900
DPI = 100


def main() -> None:
    records = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    matplotlib.use("Agg")
    from matplotlib import pyplot

    found = [
        (size, values["values"])
        for name, size in SIZES.items()
        if (values := records.get(f"{name}_seconds"))
    ]
    sizes = np.array([size for size, _ in found], float)
    middles = np.array([statistics.median(values) for _, values in found])
    figure, axes = pyplot.subplots(figsize=(WIDTH / DPI, 4.2), dpi=DPI)
    even = sizes * np.log(sizes)
    axes.plot(sizes, middles[-1] * even / even[-1], "--", color="0.6", label="N log N")
    ends = np.array([(min(values), max(values)) for _, values in found]).T
    axes.errorbar(sizes, middles, abs(ends - middles), marker="o", capsize=3, label="default")
    axes.set(xscale="log", yscale="log", xlabel="points of each cloud, N", ylabel="seconds")
    axes.grid(True, which="both", color="0.92")
    axes.legend(frameon=False)
    figure.tight_layout()
    figure.savefig(sys.argv[2])


if __name__ == "__main__":
    main()

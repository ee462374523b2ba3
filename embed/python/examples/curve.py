"""Draws the curves of training runs: curve.py OUT.svg NAME=RUN [NAME=RUN ...]. Needs matplotlib."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt


def main() -> None:
    """Draws them."""
    out, *runs = sys.argv[1:]
    plt.rcParams["svg.hashsalt"] = "surefoot"
    figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
    for run in runs:
        name, folder = run.split("=", 1)
        with (Path(folder) / "curve.csv").open() as file:
            rows = list(csv.DictReader(file))
        decisions = [int(row["decisions"]) / 1000 for row in rows]
        axes.plot(decisions, [100 * float(row["success"]) for row in rows], label=name)
    axes.axhline(80, color="grey", linewidth=0.8, linestyle=":")
    axes.set(xlabel="thousands of decisions", ylabel="goals reached, %", ylim=(0, 100), xlim=(0, None))
    axes.legend(loc="lower right")
    figure.savefig(out, metadata={"Date": None})


if __name__ == "__main__":
    main()

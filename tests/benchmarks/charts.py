"""The charts of the report, as SVG."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from collect import Results
from frames import COUNTS, LINE_KINDS, SWEEPS, TABLE_KINDS, Cell
from methods import LABELS
from scaling import SIDES, Point
from stats import FAR, Summary

mpl.use("Agg")
mpl.rcParams |= {
    "svg.hashsalt": "benchmarks",
    "svg.fonttype": "none",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
}

import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.ticker import NullFormatter  # noqa: E402

STYLES = {
    "sketch": ("#999999", "s"),
    "balanced": ("#0072b2", "o"),
    "paper": ("#009e73", "D"),
    "active_contour": ("#d55e00", "^"),
    "filaments": ("#e69f00", "v"),
    "splender": ("#cc79a7", "P"),
}
SWEEP_METHODS = ("balanced", "paper", "active_contour", "filaments", "splender")
SWEEP_NAMES = {"rotation": "rotation, °", "displacement": "displacement, px", "scaling": "scale"}


def _logarithmic(panel: Axes, axes: str) -> None:
    """Make axes logarithmic, with numbers at powers of ten only."""
    for name in axes:
        panel.set(**{f"{name}scale": "log"})
        getattr(panel, f"{name}axis").set_minor_formatter(NullFormatter())


def save(figure: Figure, path: Path) -> None:
    """Write an SVG that does not change when nothing in it does."""
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def speed_accuracy(results: Results, path: Path) -> None:
    """Draw seconds a frame against average DTW, a point for each method, a panel for each task."""
    tasks = [(f"{n} bod{'y' if n == 1 else 'ies'}", [_cells((n,), TABLE_KINDS)]) for n in COUNTS]
    tasks.append(("straight lines, 1 to 3 bodies", [_cells(COUNTS, LINE_KINDS)]))
    figure, panels = plt.subplots(
        1, 4, figsize=(13, 4), sharex=True, sharey=True, layout="constrained"
    )
    for panel, (title, cells) in zip(panels, tasks, strict=True):
        found = {n: results.summary(n, *cells[0]) for n in results.names if n != "sketch"}
        _points(panel, {name: s for name, s in found.items() if s})
        panel.set(title=title, xlabel="seconds a frame, one core")
        _logarithmic(panel, "xy")
    for panel, count in zip(panels, COUNTS, strict=False):
        bound = results.bound(count)
        if bound:
            panel.axhline(bound.median, color="black", linestyle=":", linewidth=1)
    panels[0].set_ylabel("average DTW, px (median and quartiles)")
    handles, labels = _legend(panels)
    figure.legend(handles, labels, loc="outside lower center", ncols=7, frameon=False)
    save(figure, path)


def _cells(counts: Sequence[int], kinds: Sequence[tuple[str, float]]) -> list[Cell]:
    return [Cell(n, kind, strength) for n in counts for kind, strength in kinds]


def _points(panel: Axes, found: dict[str, Summary]) -> None:
    for name, s in found.items():
        color, marker = STYLES[name]
        panel.errorbar(
            s.seconds,
            s.median,
            xerr=[[s.seconds - s.seconds_low], [s.seconds_high - s.seconds]],
            yerr=[[s.median - s.low], [s.high - s.median]],
            color=color,
            marker=marker,
            linewidth=1,
            label=LABELS[name],
        )


def _legend(panels: Sequence[Axes]) -> tuple[list, list[str]]:
    entries = {}
    for panel in panels:
        handles, labels = panel.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    return list(entries.values()), list(entries)


def sweeps(results: Results, path: Path) -> None:
    """Draw average DTW against the strength of the perturbation: Figure 2."""
    figure, panels = plt.subplots(3, 3, figsize=(12, 9), sharey=True, layout="constrained")
    for row, count in zip(panels, COUNTS, strict=True):
        for panel, kind in zip(row, SWEEPS, strict=True):
            for name in SWEEP_METHODS:
                _sweep(panel, results, name, count, kind)
            panel.set(xlabel=SWEEP_NAMES[kind], title=f"{count} in a frame")
            _logarithmic(panel, "y")
        row[0].set_ylabel("average DTW, px")
    figure.legend(*_legend(panels.ravel()), loc="outside lower center", ncols=8, frameon=False)
    save(figure, path)


def _sweep(panel: Axes, results: Results, name: str, count: int, kind: str) -> None:
    """Draw the median as a line and the middle 80 % of bodies as a band."""
    points = [(s, results.of(name, [Cell(count, kind, s)])) for s in SWEEPS[kind]]
    points = [(s, rows) for s, rows in points if rows]
    if not points:
        return
    strengths = [s for s, _ in points]
    cuts = np.array([np.quantile([r.dtw for r in rows], [0.1, 0.5, 0.9]) for _, rows in points])
    initial = np.array([np.median([r.initial for r in rows]) for _, rows in points])
    initial[initial == 0] = np.nan  # not on a logarithmic axis
    color, marker = STYLES[name]
    panel.plot(strengths, cuts[:, 1], color=color, marker=marker, markersize=4, label=LABELS[name])
    if name == "balanced":
        panel.fill_between(strengths, cuts[:, 0], cuts[:, 2], color=color, alpha=0.15, linewidth=0)
        panel.plot(strengths, initial, color=STYLES["sketch"][0], linestyle="--", label="sketch")
        panel.fill_between(strengths, initial, 100, color="#d55e00", alpha=0.06, linewidth=0)
        panel.axhline(FAR, color="black", linewidth=0.5)
        panel.set_ylim(0.08, 60)


def worse(results: Results, path: Path) -> None:
    """Draw the share of bodies that refinement left further away than their sketch."""
    figure, panels = plt.subplots(3, 3, figsize=(12, 8), sharey=True, layout="constrained")
    for row, count in zip(panels, COUNTS, strict=True):
        for panel, kind in zip(row, SWEEPS, strict=True):
            for name in SWEEP_METHODS:
                found = [(s, results.summary(name, Cell(count, kind, s))) for s in SWEEPS[kind]]
                line = [(s, 100 * f.worse) for s, f in found if f and f.initial_half > FAR / 10]
                if line:
                    color, marker = STYLES[name]
                    panel.plot(
                        *zip(*line, strict=True), color=color, marker=marker, label=LABELS[name]
                    )
            panel.set(xlabel=SWEEP_NAMES[kind], title=f"{count} in a frame")
        row[0].set_ylabel("got worse, % of bodies")
    figure.legend(*_legend(panels.ravel()), loc="outside lower center", ncols=6, frameon=False)
    save(figure, path)


def scaling(points: Sequence[Point], path: Path) -> None:
    """Draw time against the number of curves and against the image's size, and memory."""
    figure, panels = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
    for name in dict.fromkeys(p.method for p in points):
        counts = [p for p in points if p.method == name and p.what == "count"]
        sides = [p for p in points if p.method == name and p.what == "side"]
        color, marker = STYLES[name]
        style = {"color": color, "marker": marker, "label": LABELS[name]}
        panels[0].plot([p.bodies for p in counts], [p.seconds for p in counts], **style)
        panels[1].plot([p.side for p in sides], [p.seconds for p in sides], **style)
        panels[2].plot([p.bodies for p in counts], [p.peak_mib for p in counts], **style)
    panels[0].set(xlabel="curves", ylabel="seconds", title="4194 px² a body")
    panels[1].set(xlabel="height and width, px", ylabel="seconds", title="10 curves", ylim=(0.1, 1))
    panels[2].set(xlabel="curves", ylabel="peak memory, MiB", ylim=(100, 4000))
    for panel in panels:
        if any(len(line.get_xdata()) for line in panel.lines):
            _logarithmic(panel, "xy")
    panels[1].set_xticks(SIDES, labels=map(str, SIDES))
    figure.legend(*_legend(panels), loc="outside lower center", ncols=6, frameon=False)
    save(figure, path)

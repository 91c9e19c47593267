"""Does the reconstruction loss tell a good refinement from a failed one?

    python tests/benchmarks/paper_score.py [--frames 24]

Generated frames of one to three bodies, from sketches spoilt so much that some refinements fail.
Writes docs/benchmarks/paper_score.csv, one row a frame, as it goes; frames that are there already
are skipped. Ends by writing into docs/method.md how often a failed frame has the
higher score of a failed and a good one (the area under the curve), for the loss itself and for
the loss divided by the variance of the noise.
"""

import argparse
import csv
from pathlib import Path

import frames
import numpy as np
from insert import insert
from scipy.stats import rankdata

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.look.scene import Scene, read_scenes
from napari_splinesketch.metrics import average_dtw
from napari_splinesketch.paper import phases

ROWS = Path(__file__).parents[2] / "docs" / "benchmarks" / "paper_score.csv"
COLUMNS = ("bodies", "kind", "index", "worst", "loss", "noise")
KINDS = (("rotation", 45.0), ("displacement", 20.0), ("pca", 2.0), ("chord", 0.0))
FAR = 2.0


def refined(
    frame: frames.Frame, settings: phases.PaperSettings | None = None
) -> tuple[Scene, phases.PaperFit]:
    """The image as `refine` normalises it, and what the paper's method finds in it."""
    ((_, seen),) = read_scenes(frame.image, frame.truths, "auto", None)
    found = phases.refine_paper(
        seen.normal,
        list(frame.sketches),
        half_width=seen.half_width,
        seed=0,
        report=lambda *_: None,
        settings=settings or phases.PaperSettings(),
    )
    return seen, found


def measure(cell: frames.Cell, index: int) -> tuple[float, float, float]:
    """Average DTW of the worst body, px; loss; noise variance, both by squared contrast."""
    frame = frames.frame(cell, index)
    seen, found = refined(frame)
    curves = [spline.sample(knots, 100)[:, :2] for knots in found.knots]
    worst = max(average_dtw(c, t) for c, t in zip(curves, frame.truths, strict=True))
    return worst, found.score, seen.noise**2


def read() -> dict[tuple[int, str, int], np.ndarray]:
    """Worst, loss and noise of the frames so far."""
    if not ROWS.exists():
        return {}
    with ROWS.open(newline="", encoding="utf-8") as file:
        return {
            (int(r["bodies"]), r["kind"], int(r["index"])): np.array(
                [float(r[name]) for name in COLUMNS[3:]]
            )
            for r in csv.DictReader(file)
        }


def run(count: int) -> None:
    """Measure the frames that have no row yet."""
    done = read()
    ROWS.parent.mkdir(parents=True, exist_ok=True)
    with ROWS.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not done:
            writer.writerow(COLUMNS)
        for index in range(count):
            bodies, (kind, strength) = 1 + index % 3, KINDS[index // 3 % len(KINDS)]
            if (bodies, kind, index) not in done:
                values = measure(frames.Cell(bodies, kind, strength), index)
                writer.writerow([bodies, kind, index, *(f"{v:.4g}" for v in values)])
                file.flush()


def area(score: np.ndarray, failed: np.ndarray) -> float:
    """Share of pairs of a failed and a good frame in which the failed one scores higher."""
    if failed.all() or not failed.any():
        return float("nan")
    ranks = rankdata(score)[failed].sum()
    bad, good = failed.sum(), (~failed).sum()
    return float((ranks - bad * (bad + 1) / 2) / (bad * good))


def table(rows: np.ndarray) -> str:
    """Quartiles of both scores over good and failed frames, and the area under the curve."""
    worst, loss, noise = rows.T
    failed = worst > FAR
    lines = [
        "| score | good frames: quartiles | failed frames: quartiles | area under the curve |",
        "|---|---|---|---|",
    ]
    for name, score in {"loss": loss, "loss / noise variance": loss / noise}.items():
        spread = [
            " · ".join(f"{q:.3g}" for q in np.quantile(score[which], [0.25, 0.5, 0.75]))
            if which.any()
            else "none"
            for which in (~failed, failed)
        ]
        lines.append(f"| {name} | {spread[0]} | {spread[1]} | {area(score, failed):.2f} |")
    found = f"{len(rows)} frames, {failed.sum()} with a body beyond {FAR:g} px.\n\n"
    return found + "\n".join(lines) + "\n"


def main() -> None:
    """Run what is missing, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=24)
    run(parser.parse_args().frames)
    text = table(np.array(list(read().values())))
    insert("paper_score", text)
    print(text)


if __name__ == "__main__":
    main()

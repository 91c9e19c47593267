"""Work in a window of its own, as a user does, until somebody kills the process."""

import sys

import napari
import numpy as np
from fakes import FakeEngine
from hand import QTest, add_dock, click, draw, fit_view, refine, until

from napari_splinesketch.plugin import engine

LINES = [[(20, 20), (24, 60)], [(50, 30), (60, 70), (80, 80)], [(70, 15), (85, 40)]]


def main() -> None:
    """Draw two lines, refine, accept one curve, draw a third line; say when, and live on."""
    fake = FakeEngine()
    fake.go.set()
    engine.refine, engine.warm_up = fake.refine, lambda report: None
    viewer = napari.Viewer()
    viewer.window.resize(900, 640)
    viewer.open(sys.argv[1])
    dock = add_dock(viewer)
    fit_view(viewer)
    click(dock.draw)
    sketches = dock.controller.sketches
    assert sketches is not None
    for line in LINES[:2]:
        draw(viewer, sketches, line)
    refine(dock)
    dock.controller.review("accepted", (0, 2))
    until(lambda: not dock.controller.progress)
    draw(viewer, sketches, LINES[2])
    print([np.round(line, 3).tolist() for line in sketches.data], flush=True)
    # Two seconds of its own: on a busy machine they are longer.
    for _ in range(40):
        QTest.qWait(50)
    print("kill me", flush=True)
    while True:
        QTest.qWait(50)


if __name__ == "__main__":
    main()

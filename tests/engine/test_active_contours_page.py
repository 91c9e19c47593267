"""The Python on the page about active contours runs, and does what the page says."""

import re
import textwrap
from pathlib import Path

import numpy as np
import perturbations

from napari_splinesketch import synthetic
from napari_splinesketch.metrics import average_dtw

PAGE = Path(__file__).parents[2] / "docs" / "active_contours.md"
BLOCKS = [
    textwrap.dedent(block)
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
]


def test_one_call_replaces_an_active_contour() -> None:
    scene = synthetic.scene(1, polarity="bright")
    sketch = perturbations.displace(scene.centrelines[0], 2, 30)
    found = {}
    for name, block in zip(("contour", "ours"), BLOCKS[:2], strict=True):
        assert len([line for line in block.splitlines() if line]) <= 5
        names = {"image": scene.image, "sketch": sketch}
        exec(block, names)
        found[name] = average_dtw(np.asarray(names["curve"]), scene.centrelines[0])
    assert found["ours"] < 0.6 and found["ours"] < found["contour"] < 3


def test_predictions_of_a_film_are_refined_in_order() -> None:
    names: dict = {}
    loop, flags, example = BLOCKS[2:]
    exec(loop.split("refined, results =")[0], names)
    exec(example, names)
    exec("refined, results = refine_film(frames, predictions)\n" + flags, names)
    for scene, before, after in zip(
        names["scenes"], names["predictions"], names["refined"], strict=True
    ):
        assert after.shape == (2, 100, 2)
        for truth, predicted, refined in zip(scene.centrelines, before, after, strict=True):
            assert average_dtw(refined, truth) < min(1.0, average_dtw(predicted, truth))
    assert [len(row) for row in names["sure"]] == [2, 2]

"""What the page about the paper's method shows, run as it stands."""

import re
import shlex
from functools import partial
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import tifffile

from napari_splinesketch import read_labels, refine, synthetic
from napari_splinesketch.cli import main
from napari_splinesketch.engine.spline import arc_length
from napari_splinesketch.metrics import average_dtw
from napari_splinesketch.paper import phases

PAGE = (Path(__file__).parents[2] / "docs" / "method.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
SCENES = [synthetic.scene(seed, shape=(96, 112), length=60) for seed in range(2)]


def block(word: str) -> str:
    (found,) = [text for text in PYTHON if word in text]
    return found


def test_predictions_of_one_image_are_refined() -> None:
    names: dict = {}
    exec(block("compress"), names)
    for truth, before, after in zip(
        names["scene"].centrelines, names["predicted"], names["refined"], strict=True
    ):
        assert average_dtw(after, truth) < min(0.6, average_dtw(before, truth))


def test_predictions_of_a_film_are_refined_by_one_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    tifffile.imwrite("film.tif", np.stack([s.image for s in SCENES]), photometric="minisblack")
    predicted = [[synthetic.compress(c, 2)[:, ::-1] for c in s.centrelines] for s in SCENES]
    np.savez("predictions.npz", splines=np.array(predicted))
    (command,) = re.findall(r"```bash\n(napari-splinesketch refine .*)\n```", PAGE)
    assert main(shlex.split(command)[1:]) == 0
    found = read_labels("labels.csv").labels
    assert [label.frame for label in found] == [0, 1]
    for label, scene in zip(found, SCENES, strict=True):
        assert average_dtw(label.points, scene.centrelines[0]) < 0.6


def test_width_is_drawn_against_arc_length() -> None:
    mpl.use("Agg")
    scene = SCENES[0]
    names: dict = {"result": refine(scene.image, scene.centrelines)}
    exec(block("plt.plot"), names)
    x, y = names["plt"].gca().lines[0].get_data()
    names["plt"].close()
    assert np.asarray(x)[-1] == pytest.approx(arc_length(scene.centrelines[0])[-1], abs=3.5)
    middle = slice(40, 60)
    assert np.mean(np.asarray(y)[middle]) == pytest.approx(
        scene.half_widths[0][middle].mean(), rel=0.15
    )


@pytest.mark.slow
def test_each_body_is_rendered_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    few = phases.PaperSettings(background_steps=40, splines_steps=60, everything_steps=10, seeds=1)
    monkeypatch.setattr(phases, "refine_paper", partial(phases.refine_paper, settings=few))
    # As large as the scenes of test_phases.py, which are fitted by the same compiled programs.
    scene = synthetic.scene(0, shape=(110, 128), length=80)
    predicted = list(scene.centrelines)
    result = refine(scene.image, predicted)
    names: dict = {"scene": scene, "predicted": predicted, "result": result}
    exec(block("render_bodies"), names)
    (body,), normal = names["bodies"], names["normal"]
    assert body.shape == normal.shape
    row, col = np.round(scene.centrelines[0][10:-10]).astype(int).T
    assert np.median(body[row, col]) == pytest.approx(np.median(normal[row, col]), rel=0.25)
    assert abs(np.median(body)) < 0.01

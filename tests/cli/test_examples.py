"""Every example of the help and of the documentation, run as it stands."""

import argparse
import re
import shlex
from pathlib import Path

import imageio.v3
import numpy as np
import pytest
import tifffile

from napari_splinesketch.cli import main
from napari_splinesketch.cli.commands import make_parser
from napari_splinesketch.labels import Label, Labels, read_labels, write_labels

from .fakes import FakeEngine, curve, film

SubParsers = argparse._SubParsersAction
ROOT = Path(__file__).parents[2]
LINE = np.array([[5.0, 6.0], [25.0, 46.0]])


def examples() -> list[str]:
    """All command lines, each once, those broken by a backslash put together."""
    parser = make_parser()
    commands = next(action for action in parser._actions if isinstance(action, SubParsers))
    texts = [parser.description or ""]
    texts += [command.format_help() for command in commands.choices.values()]
    texts += [
        "\n".join(re.findall(r"```bash\n(.*?)```", path.read_text(encoding="utf-8"), re.S))
        for path in (ROOT / "docs" / "files.md", ROOT / "docs" / "index.md")
    ]
    joined = "\n".join(texts).replace("\\\n", " ")
    lines = re.findall(r"^ *(napari-splinesketch [a-z-]+ .*)$", joined, re.M)
    wordy = (line for line in lines if "IMAGE" not in line and "--help" not in line)
    return sorted({" ".join(shlex.split(re.sub(r"  +\S.*|#.*", "", line))) for line in wordy})


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What the examples take for granted: images, sketches, labels and a truth."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("napari_splinesketch.cli.commands.why_no_window", lambda: "none in a test")
    frames = film(3)
    tifffile.imwrite("worms.tif", frames[0])
    tifffile.imwrite("film.tif", frames, photometric="minisblack")
    imageio.v3.imwrite("worms.png", frames[0])
    Path("frames").mkdir()
    for i, frame in enumerate(frames):
        imageio.v3.imwrite(f"frames/{i}.png", frame)
    sketch = Labels((Label.from_sketch(LINE),))
    write_labels("sketches.shapes.csv", sketch)
    Path("sketches.shapes.csv").rename("sketches.csv")
    write_labels("film.csv", Labels(tuple(Label.from_sketch(LINE, frame=i) for i in range(3))))
    write_labels("truth.csv", sketch)
    return tmp_path


def test_there_are_examples_of_every_command() -> None:
    assert {line.split()[1] for line in examples()} == {
        *("demo", "refine", "suggest", "track", "convert", "compare", "export-training")
    }
    assert len(examples()) > 12


@pytest.mark.parametrize("line", examples())
def test_the_example_runs(
    line: str,
    folder: Path,
    engine: FakeEngine,
    elsewhere: dict[str, str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("PYTHONPATH", elsewhere["PYTHONPATH"])  # for the example with --jobs
    arguments = shlex.split(line)[1:]
    if "labels.csv" in arguments and arguments[0] in ("convert", "compare"):
        write_labels("labels.csv", read_labels("film.csv"))
    if arguments[0] == "export-training":
        labels = [Label.from_curve(curve(LINE), frame=i, review="accepted") for i in range(3)]
        write_labels("labels.csv", Labels(tuple(labels)))
    if "lines.csv" in arguments:
        Path("sketches.csv").rename("lines.csv")
    assert main(arguments) == 0, capsys.readouterr().err
    if "-o" in arguments:
        output = Path(arguments[arguments.index("-o") + 1])
        assert (output / "manifest.json" if output.is_dir() else output).stat().st_size
    elif arguments[0] == "convert":
        assert Path(arguments[2]).stat().st_size

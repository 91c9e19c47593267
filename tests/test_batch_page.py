"""docs/batch.md does what it says: its blocks are run, one after another."""

import os
import re
import socket
import subprocess
import sys
from collections import Counter
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import pytest

from napari_splinesketch.labels import read_labels
from napari_splinesketch.training import read_training

PAGE = (Path(__file__).parents[1] / "docs" / "batch.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"```(python|bash)\n(.*?)```", re.S)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def run_in_shell(block: str) -> None:
    """Run commands, those of this environment, on a port that is free."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    run = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block.replace("8786", str(free_port()))],
        env={**os.environ, "PATH": path},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert run.returncode == 0, f"{block}\n{run.stderr}"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the blocks are for a POSIX shell")
def test_every_block_of_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    kinds = Counter()
    for kind, blocks in groupby(BLOCK.findall(PAGE), key=itemgetter(0)):
        texts = [text for _, text in blocks]
        kinds[kind] += len(texts)
        if kind == "bash":
            run_in_shell("\n".join(texts))
        else:
            exec(compile("\n".join(texts), "docs/batch.md", "exec"), names)
    assert kinds["python"] >= 4
    assert kinds["bash"] >= 4
    assert len(read_labels("labels.csv").labels) == 25
    assert Path("films/day-2.labels.csv").read_bytes() == Path("labels.csv").read_bytes()
    assert Path("todo.txt").read_text() == "films/day-3.tif: exit code 2\n"
    assert "films/day-3.tif: cannot be read as TIFF" in Path("films/day-3.log").read_text()
    assert len(read_training("training")) > 20
    told = capsys.readouterr().out
    predicted = [float(text) for text in re.findall(r"labels: predicted to ([\d.]+) px", told)]
    assert len(predicted) == 3
    assert predicted[2] < predicted[0] < 2
    assert float(re.findall(r"refined to ([\d.]+) px", told)[0]) < predicted[2] / 2
    # The page shows what it prints, but for the last digits: processors round differently.
    shown = [float(text) for text in re.findall(r"labels: predicted to (\d.*) px", PAGE)]
    assert shown == pytest.approx(predicted, rel=0.2)

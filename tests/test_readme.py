"""The README's promises: its Python runs, and the lines that CI runs are there."""

import re
import subprocess
from pathlib import Path

import pytest

from napari_splinesketch.labels import read_labels

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", README, re.S)
    exec(compile(code, "README.md", "exec"), {})
    assert len(read_labels("labels.csv").labels) == 24


def test_ci_runs_the_readme_s_two_commands() -> None:
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    patterns = re.findall(r"grep -m1 '(.*?)' README\.md", ci)
    assert len(patterns) == 2
    for pattern in patterns:
        run = subprocess.run(
            ["grep", "-c", pattern, "README.md"], cwd=ROOT, capture_output=True, text=True
        )
        assert run.stdout == "1\n", pattern

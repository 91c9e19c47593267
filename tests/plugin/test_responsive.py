"""The window lives on while JAX is imported, programs are compiled and curves refined."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

GAPS = Path(__file__).with_name("measure_gaps.py")


@pytest.mark.slow
def test_the_longest_gap_between_ticks(qapp: Any, tmp_path: Path, capsys: Any) -> None:
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(tmp_path)}
    result = subprocess.run(
        [sys.executable, GAPS], env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    phases = json.loads(result.stdout.splitlines()[-1])
    with capsys.disabled():
        print("\nlongest gap between ticks:")
        for name, (seconds, gap) in phases.items():
            print(f"  {name:32} {seconds:6.1f} s {1000 * gap:6.0f} ms")
    assert list(phases) == ["idle", "import and warm-up", "first refinement", "from the cache"]
    assert phases["first refinement"][0] > 0
    # A window that stood still through the work would show a gap as long as the work.
    for name, (seconds, gap) in phases.items():
        assert gap < max(0.5 * seconds, 2.0), name

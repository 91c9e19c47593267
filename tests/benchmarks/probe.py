"""One method on given scenes in an interpreter of its own: first and later calls, peak memory.

    python tests/benchmarks/probe.py METHOD REPEATS SCENE.npz...

prints one JSON object a line, for each scene in turn.
"""

import json
import sys
import time
from pathlib import Path

BEGAN = time.process_time()

from collections.abc import Sequence  # noqa: E402
from typing import TYPE_CHECKING  # noqa: E402

import numpy as np  # noqa: E402

if TYPE_CHECKING:
    from frames import Frame
    from methods import Method


def main() -> None:
    """Run the method on the scenes."""
    name, repeats, *paths = sys.argv[1:]
    import methods
    from frames import Frame
    from runner import pin_to_one_core

    pin_to_one_core()
    method = methods.make(name)
    imported = time.process_time() - BEGAN
    for path in map(Path, paths):
        data = np.load(path)
        given = Frame(data["image"], bool(data["bright"]), (), tuple(data["sketches"]))
        first, curves = _timed(method, given)
        later = [_timed(method, given)[0] for _ in range(int(repeats))]
        np.savez(path.with_suffix(f".{name}.npz"), curves=np.stack(curves))
        peak = _peak_mib()
        seconds = float(np.median(later)) if later else first
        record = {"imported": imported, "first": first, "seconds": seconds, "peak_mib": peak}
        print(json.dumps(record), flush=True)


def _peak_mib() -> float:
    """Largest resident memory so far; `getrusage` would count that of the parent, too."""
    status = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024


def _timed(method: "Method", given: "Frame") -> "tuple[float, Sequence[np.ndarray]]":
    """Seconds of this core's work, and the curves."""
    began = time.process_time()
    answer = method.run(given)
    return time.process_time() - began, answer.curves


if __name__ == "__main__":
    main()

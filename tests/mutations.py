"""Put each fault of `mutations.toml` into a copy, and see whether the tests named there notice.

Run as `python tests/mutations.py`, with words to choose faults by (of their file or description).
"""

import os
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree, ignore_patterns

ROOT = Path(__file__).parents[1]
CHECKED = ("-q", "-x", "-m", "", "-p", "no:cacheprovider", "--hypothesis-seed=0")
CAUGHT, MISSED, GONE = "caught", "missed", "gone"


@dataclass(frozen=True)
class Fault:
    """A change to the code that some test ought to notice.

    Attributes
    ----------
    file
        Where, in the package; elsewhere in it if the text has moved.
    what
        What goes wrong, in the user's words.
    old, new
        Text that occurs once, and what takes its place.
    tests
        Files, in tests/.
    """

    file: str
    what: str
    old: str
    new: str
    tests: tuple[str, ...]

    def place(self, package: Path) -> Path | None:
        """Give the one file that holds the text, or None."""
        named = package / self.file
        if named.exists() and named.read_text(encoding="utf-8").count(self.old) == 1:
            return named
        every = {path: path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
        found = [path for path, text in every.items() if self.old in text]
        return found[0] if len(found) == 1 and every[found[0]].count(self.old) == 1 else None

    def asked(self, tests: Path) -> list[str]:
        """Give the tests that there are; where one is gone, all beside it."""
        paths = (tests / name for name in self.tests)
        return sorted({str(path if path.exists() else path.parent) for path in paths})


def outcome(fault: Fault, copy: Path) -> tuple[str, str]:
    """Put a fault in and take it out again: what came of it, and the test that noticed."""
    place = fault.place(copy / "src" / "napari_splinesketch")
    if place is None:
        return GONE, ""
    whole = place.read_text(encoding="utf-8")
    place.write_text(whole.replace(fault.old, fault.new), encoding="utf-8")
    try:
        run = subprocess.run(
            [sys.executable, "-B", "-m", "pytest", *CHECKED, *fault.asked(copy / "tests")],
            cwd=copy,
            env={**os.environ, "PYTHONPATH": str(copy / "src")},
            capture_output=True,
            text=True,
        )
    finally:
        place.write_text(whole, encoding="utf-8")
    failed = [line for line in run.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if run.returncode not in (0, 1, 2):
        raise RuntimeError(
            f"pytest could not run for {fault.what!r}:\n{run.stdout[-2000:]}{run.stderr[-2000:]}"
        )
    if not run.returncode:
        return MISSED, ""
    return CAUGHT, failed[0].split("::")[-1].split(" - ")[0] if failed else "collection"


def faults() -> list[Fault]:
    """Give every fault."""
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    return [Fault(**one) for one in tomllib.loads(text)["fault"]]


def main(words: list[str]) -> None:
    """Print a table of the chosen faults."""
    chosen = [f for f in faults() if not words or any(word in f.file + f.what for word in words)]
    count: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["JAX_COMPILATION_CACHE_DIR"] = str(Path(folder) / "jax")
        copy = Path(folder) / "copy"
        ignored = ignore_patterns(".git", ".venv", ".pytest_cache", "__pycache__", "docs")
        copytree(ROOT, copy, ignore=ignored)
        print("| file | fault | outcome | noticed by |\n|---|---|---|---|", flush=True)
        for fault in chosen:
            came, by = outcome(fault, copy)
            count[came] += 1
            print(f"| {fault.file} | {fault.what} | {came} | {by} |", flush=True)
    print("\n" + ", ".join(f"{count[one]} {one}" for one in (CAUGHT, MISSED, GONE)))


if __name__ == "__main__":
    main(sys.argv[1:])

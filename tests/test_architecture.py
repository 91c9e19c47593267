"""Who may import whom: each case is imported in a fresh interpreter."""

import subprocess
import sys
from importlib.resources import files
from itertools import chain
from pathlib import Path

import yaml

GUI = {"napari", "qtpy", "PyQt6", "magicgui", "vispy"}
PROBE = """
import importlib, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""


def imported_by(*modules: str) -> set[str]:
    """Top-level packages that a fresh interpreter holds after importing `modules`."""
    result = subprocess.run(
        [sys.executable, "-c", PROBE, *modules], capture_output=True, text=True, check=True
    )
    return set(result.stdout.split())


def modules_of(package: str) -> list[str]:
    """Every module of a subpackage and of those below it, by its dotted name."""
    root = Path(str(files("napari_splinesketch")))
    paths = (path.relative_to(root.parent) for path in (root / package).rglob("*.py"))
    return sorted(".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in paths)


def manifest_modules() -> list[str]:
    """The modules that napari imports when it runs one of the plugin's commands."""
    text = (files("napari_splinesketch") / "napari.yaml").read_text(encoding="utf-8")
    commands = yaml.safe_load(text).get("contributions", {}).get("commands", [])
    return sorted({command["python_name"].partition(":")[0] for command in commands})


def test_the_package_imports_nothing_heavy() -> None:
    assert not imported_by("napari_splinesketch") & (GUI | {"jax", "numpy", "scipy", "skimage"})


def test_labels_import_neither_jax_nor_a_window() -> None:
    names = modules_of("labels")
    assert len(names) > 3
    assert not imported_by(*names) & (GUI | {"jax", "scipy", "skimage"})


def test_the_engine_imports_no_window_and_no_files() -> None:
    names = modules_of("engine") + modules_of("paper")
    assert len(names) > 20
    assert not imported_by(*names) & GUI


def test_batches_films_images_and_training_sets_import_neither_jax_nor_a_window() -> None:
    packages = [modules_of(name) for name in ("batch", "images", "tracking", "training")]
    assert min(map(len, packages)) > 3
    assert not imported_by(*chain(*packages)) & (GUI | {"jax", "distributed"})


def test_the_command_line_imports_nothing_heavy() -> None:
    assert not imported_by("napari_splinesketch.cli") & (GUI | {"jax", "scipy", "skimage"})


def test_what_the_user_can_put_right_is_an_error_of_ours() -> None:
    paths = Path(str(files("napari_splinesketch"))).rglob("*.py")
    wrong = [path.name for path in paths if "raise ValueError" in path.read_text("utf-8")]
    assert not wrong, "raise InputError: other errors are taken for faults of the program"


def test_opening_the_plugin_menu_imports_neither_jax_nor_plots() -> None:
    modules = manifest_modules()
    assert len(modules) >= 2
    assert not imported_by(*modules) & {"jax", "pyqtgraph"}

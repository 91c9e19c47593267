"""What the user chooses is kept, and acts."""

import errno
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from napari.layers import Image
from napari.settings import get_plugin_settings
from napari.settings._base import EventedConfigFileSettings
from npe2 import PluginManifest
from qtpy.QtCore import QLocale, Qt  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtWidgets import QLabel

from napari_splinesketch.plugin import choices as settings
from napari_splinesketch.plugin.choices import PLUGIN, Settings
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers.space import Ruler

from .fakes import FakeEngine
from .hand import QTest, add_dock, canvas, click, refine, until

HALF_WIDTHS = {
    "measured": (None, "px", "µm", 0.5, None),
    "same unit": (2.0, "µm", "µm", 0.5, 4.0),
    "other unit": (2000.0, "nm", "µm", 0.5, 4.0),
    "px": (3.0, "px", "px", 1.0, 3.0),
    "px on an image with a unit": (3.0, "px", "µm", 0.5, 3.0),
    "a unit on an image without": (3.0, "µm", "px", 1.0, None),
    "a unit of something else": (3.0, "s", "µm", 0.5, None),
    "no unit": (3.0, "foo", "µm", 0.5, None),
    "no unit, on an image without": (3.0, "1/0", "px", 1.0, None),
}


@pytest.mark.parametrize("name", HALF_WIDTHS)
def test_half_width_in_px(name: str) -> None:
    value, unit, image_unit, pixel, wanted = HALF_WIDTHS[name]
    chosen = Settings(half_width=value, half_width_unit=unit)
    found = chosen.half_width_in(Ruler((pixel, pixel), image_unit))
    assert found == (wanted if wanted is None else pytest.approx(wanted))


@pytest.mark.parametrize(
    ("name", "wrong"),
    [("preset", "x"), ("polarity", "up"), ("half_width", -1.0), ("half_width", np.inf)],
)
def test_what_nobody_can_have_chosen_is_refused(
    name: str, wrong: Any, plugin_settings: None, npe2pm_installed: None
) -> None:
    with pytest.raises(ValueError, match=name):
        settings.save(replace(Settings(), **{name: wrong}))
    assert replace(settings.load(), keys={}) == Settings()


def test_a_script_that_chooses_what_there_is_not_is_told_so(
    viewer: Any, fake: FakeEngine, npe2pm_installed: None
) -> None:
    controller = add_dock(viewer).controller
    with pytest.raises(ValueError, match="'balanced', 'paper'"):
        controller.choose(preset="fast")
    assert controller.settings.preset == "balanced"


def test_the_manifest_has_every_key_and_default(
    viewer: Any, fake: FakeEngine, npe2pm_installed: None
) -> None:
    assert replace(settings.load(), keys={}) == Settings()
    dock = add_dock(viewer)
    assert dock.controller.actions.keys == settings.load().keys


def test_a_half_width_is_in_the_unit_that_was_shown(
    viewer: Any, fake: FakeEngine, npe2pm_installed: None
) -> None:
    dock = add_dock(viewer)
    form = dock.settings_form
    image = viewer.add_image(np.random.default_rng(0).random((64, 96)))
    image.scale, image.units = (0.5, 0.5), ("um", "um")
    assert form.half_width.suffix() == " px"
    form.half_width.setValue(3.0)
    assert form.half_width.text() == "1.500 µm"


def test_the_form_and_the_manifest_have_the_same_largest_half_width() -> None:
    manifest = PluginManifest.from_distribution(PLUGIN)
    pages: Any = manifest.model_dump()["contributions"]["configurations"]
    most = pages["refining"]["properties"]["half_width"]["maximum"]
    assert most == settings.FORM["half_width"]["max"]


@pytest.mark.parametrize(
    ("unit", "pixel", "shown"), [("nm", 500.0, "40000.000 nm"), ("mm", 6.5e-5, "0.0400000 mm")]
)
def test_a_half_width_is_shown_however_large_or_small_in_the_unit_of_the_image(
    unit: str, pixel: float, shown: str, viewer: Any, fake: FakeEngine, npe2pm_installed: None
) -> None:
    dock = add_dock(viewer)
    place: dict[str, Any] = {"scale": (1.0, 1.0), "units": ("um", "um")}
    viewer.add_image(np.zeros((64, 96)), **place)
    dock.settings_form.half_width.setValue(40.0)
    viewer.add_image(np.zeros((64, 96)), scale=(pixel, pixel), units=(unit, unit))
    box = dock.settings_form.half_width
    assert box.text() == shown
    box.setValue(0.6 * box.value())
    asked = dock.controller.how(dock.controller.layers(Image)[0]).half_width
    assert asked == pytest.approx(box.value() / pixel)


@pytest.mark.parametrize("wrong", [40.0, 0.01])
def test_a_half_width_that_no_body_of_the_image_can_have_is_said_in_its_unit(
    wrong: float, viewer: Any, fake: FakeEngine, npe2pm_installed: None
) -> None:
    dock = add_dock(viewer)
    place: dict[str, Any] = {"scale": (0.25, 0.25), "units": ("um", "um")}
    film: dict[str, Any] = {"scale": (1.0, 0.25, 0.25), "units": ("pixel", "um", "um")}
    viewer.add_image(np.random.default_rng(0).random((3, 64, 96)), **film)
    viewer.add_shapes([[[10, 10], [10, 60]]], shape_type="line", **place)
    refine(dock)
    viewer.layers["Shapes"].add([[30, 10], [30, 60]], shape_type="line")
    dock.controller.choose(half_width=wrong, half_width_unit="µm")
    said = f"Half-width, under Settings, is {wrong:g} µm: give 0.05 to 12 µm in this image"
    assert said in dock.hint.text()
    for each in (dock.refine, dock.suggest, dock.track.buttons["track"]):
        assert said in each.toolTip()
        assert not each.isEnabled()
    dock.controller.refine("all")
    assert said in dock.notice.text()
    assert len(fake.calls) == 1
    dock.settings_form.half_width.setValue(12.0)
    refine(dock)


def test_what_is_being_typed_stays_while_layers_come(
    viewer: Any, fake: FakeEngine, npe2pm_installed: None
) -> None:
    dock = add_dock(viewer)
    form = dock.settings_form
    viewer.add_image(np.random.default_rng(0).random((64, 96)), name="x")
    form.half_width.selectAll()
    QTest.keyClicks(form.half_width, "3")
    viewer.layers["x"].name = "y"
    viewer.add_points(ndim=2)
    QTest.keyClicks(form.half_width, ".5")
    QTest.keyClick(form.half_width, Qt.Key.Key_Return)
    assert form.half_width.value() == 3.5
    assert settings.load().half_width == 3.5


def test_settings_that_cannot_be_written_hold_for_now(
    viewer: Any, fake: FakeEngine, npe2pm_installed: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*args: object, **options: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(EventedConfigFileSettings, "_maybe_save", full)
    dock = add_dock(viewer)
    dock.preset.native.setCurrentIndex(1)
    assert dock.controller.settings.preset == "paper"
    assert "(No space left on device)" in dock.notice.text()


@pytest.mark.parametrize("country", ["en_US", "de_DE", "fr_FR", "fa_IR"])
def test_a_comma_is_a_decimal_point_in_every_country(
    dock: SplinesketchDock, country: str, npe2pm_installed: None
) -> None:
    box = dock.settings_form.half_width
    box.setLocale(QLocale(country))
    for typed in ("2.75", "2,75"):
        box.setValue(0)
        box.selectAll()
        QTest.keyClicks(box, typed)
        QTest.keyClick(box, Qt.Key.Key_Return)
        assert settings.load().half_width == 2.75


def test_a_half_width_that_is_cleared_is_measured(
    dock: SplinesketchDock, npe2pm_installed: None
) -> None:
    box = dock.settings_form.half_width
    box.setValue(3.5)
    box.selectAll()
    QTest.keyClick(box, Qt.Key.Key_Delete)
    QTest.keyClick(box, Qt.Key.Key_Return)
    assert box.text() == "auto"
    assert not settings.load().half_width


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_choices_are_kept_and_used(viewer: Any, fake: FakeEngine, npe2pm_installed: None) -> None:
    dock = add_dock(viewer)
    viewer.add_image(np.random.default_rng(0).normal(100, 5, (64, 96)), name="x",
                     scale=(0.5, 0.5), units=("um", "um"))  # fmt: skip
    viewer.add_shapes([[[10, 10], [10, 60]]], shape_type="line", name="x sketches",
                      scale=(0.5, 0.5), units=("um", "um"))  # fmt: skip
    box = dock.settings_form
    assert not box.isVisible()
    click(dock.settings.title)
    assert box.isVisible()
    box.widgets["polarity"].native.setFocus()
    QTest.keyClick(box.widgets["polarity"].native, Qt.Key.Key_Down)
    click(box.half_width.lineEdit())
    QTest.keyClicks(box.half_width, "1.5")
    QTest.keyClick(box.half_width, Qt.Key.Key_Return)
    assert box.half_width.suffix() == " µm"
    form = box.widgets["save_work"].native.parentWidget()
    said = [label.text() for label in form.findChildren(QLabel) if label.text()]
    assert said == ["Bodies are", "Half-width"], "a box has its name beside it, once"
    dock.preset.native.setCurrentIndex(1)
    refine(dock)
    assert fake.calls[0]["polarity"] == "bright"
    assert fake.calls[0]["half_width"] == pytest.approx(3.0)
    assert fake.calls[0]["preset"] == "paper"
    # Another key, in napari's preferences; the one that had it is free again.
    chosen: Any = get_plugin_settings(PLUGIN)
    chosen.keys.next = "H"
    canvas(viewer).setFocus()
    QTest.keyClick(canvas(viewer), Qt.Key.Key_N)
    assert not dock.controller.selection
    QTest.keyClick(canvas(viewer), Qt.Key.Key_H)
    until(lambda: dock.controller.selection == ((0, 1),), 5)
    assert dock.controller.actions.keys["draw"] == "", "a key does one thing"
    # Another dock, another session, napari's preferences.
    kept = settings.load()
    assert (kept.preset, kept.polarity, kept.half_width) == ("paper", "bright", 1.5)
    written = Path(str(get_plugin_settings(PLUGIN).config_path))
    assert "half_width: 1.5" in written.read_text(encoding="utf-8")
    viewer.window.remove_dock_widget(dock)
    again = add_dock(viewer)
    assert again.preset.native.currentText() == "Paper"
    assert again.settings_form.half_width.value() == 1.5
    assert again.controller.actions.keys["next"] == "H"
    kept_by_napari: Any = get_plugin_settings(PLUGIN)
    kept_by_napari.refining.preset = "balanced"
    assert again.preset.native.currentText() == "Balanced"
    assert again.settings_form.half_width.text() == "1.500 µm"


@pytest.mark.window
def test_napari_makes_a_page_of_them(viewer: Any, npe2pm_installed: None) -> None:
    from napari._qt.dialogs.preferences_dialog import PreferencesDialog

    manifest = PluginManifest.from_distribution(PLUGIN)
    dialog = PreferencesDialog(parent=viewer.window._qt_window)
    pages: Any = dialog._list
    shown = [pages.item(i).text() for i in range(pages.count())]
    dialog.close()
    assert manifest.display_name in shown

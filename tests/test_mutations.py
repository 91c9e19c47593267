"""The faults that the tests are tried with can be put in: `mutations.py` itself takes long."""

import pytest

from .mutations import ROOT, Fault, faults


@pytest.mark.parametrize("fault", faults(), ids=lambda fault: fault.what)
def test_a_fault_has_its_place_and_its_tests(fault: Fault) -> None:
    package = ROOT / "src" / "napari_splinesketch"
    assert fault.place(package) == package / fault.file, "its text is gone, or there twice"
    whole = (package / fault.file).read_text(encoding="utf-8")
    assert fault.old != fault.new
    compile(whole.replace(fault.old, fault.new), fault.file, "exec")
    assert all((ROOT / "tests" / name).exists() for name in fault.tests)


def test_the_page_lists_each_fault_with_its_file() -> None:
    page = (ROOT / "docs" / "tests.md").read_text(encoding="utf-8")
    rows = [line.split(" | ") for line in page.splitlines() if line.count(" | ") == 3]
    listed = sorted((row[0].removeprefix("| "), row[1]) for row in rows if ".py" in row[0])
    assert listed == sorted((fault.file, fault.what) for fault in faults())

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

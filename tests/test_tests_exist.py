"""Tests mirror the tree: every module of the library and of the tuner has a file of its own."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ELSEWHERE = {  # modules that another file tests whole
    "jcontour/contour.py": "tests/jcontour/test_contours.py",  # evaluated there
    "jcontour/pieces.py": "tests/jcontour/test_contours.py",
    "jcontour/quintics.py": "tests/jcontour/test_contours.py",
    "jcontour/arcs.py": "tests/jcontour/test_toolpaths.py",  # what programs make of them
    "jcontour/gcode.py": "tests/jcontour/test_toolpaths.py",
    "jcontour/controller.py": "tests/test_contracts.py",  # abstract
    "jcontour/plant.py": "tests/test_contracts.py",
}
MODULES = [
    path.relative_to(ROOT).as_posix()
    for package in ("jcontour", "tuning")
    for path in sorted((ROOT / package).rglob("*.py"))
    if path.name != "__init__.py"
]


@pytest.mark.parametrize("module", MODULES)
def test_has_a_test_file(module):
    folder, _, name = module.rpartition("/")
    expected = ROOT / ELSEWHERE.get(module, f"tests/{folder}/test_{name}")
    assert expected.is_file() and "def test_" in expected.read_text(), (
        f"{module} needs {expected.relative_to(ROOT)}"
    )


def test_exceptions_are_still_needed():
    for module in ELSEWHERE:
        folder, _, name = module.rpartition("/")
        assert module in MODULES and not (ROOT / f"tests/{folder}/test_{name}").exists(), module

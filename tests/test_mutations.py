"""The table of small faults fits the code; whether tests find them, `tests/mutations` tells."""

import ast
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FAULTS = runpy.run_path(str(ROOT / "tests" / "mutations" / "faults.py"))["FAULTS"]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.file}: {fault.becomes}")
def test_the_text_is_there_once(fault):
    """And with the fault in its place the file is still Python, and there are tests near it."""
    source = (ROOT / fault.file).read_text()
    faulty = fault.put_into(source)
    assert ast.dump(ast.parse(faulty)) != ast.dump(ast.parse(source))
    assert (ROOT / fault.tests).exists()


def test_forty_faults_in_all_rooms():
    rooms = {"/".join(fault.file.split("/")[:2]) for fault in FAULTS}
    assert len(FAULTS) == len(set(FAULTS)) >= 40
    assert len(rooms) >= 13, rooms

import json

import pytest

from tests.app.tour import Tour

MACHINE = {
    "name": "tiny",
    "length_unit": "mm",
    "dt": 0.002,
    "A": [[1.0, 0.0016], [0.0, 0.6]],
    "B": [[0.0004], [0.4]],
    "C": [[1.0, 0.0]],
    "limits": {"speed": 200.0, "acceleration": 4000.0, "control": 300.0, "increment": 90.0},
    "uncertainty": {"gain": 0.1, "delay": 1},
    "encoder_resolution": 0.001,
    "control_noise": 1.0,
}


def two_axes(axis):
    """The same axis twice, as a machine."""
    n = len(axis["A"])
    A = [row + [0.0] * n for row in axis["A"]] + [[0.0] * n + row for row in axis["A"]]
    B = [row + [0.0] for row in axis["B"]] + [[0.0] + row for row in axis["B"]]
    C = [row + [0.0] * n for row in axis["C"]] + [[0.0] * n + row for row in axis["C"]]
    return {**axis, "A": A, "B": B, "C": C}


PART = "G21 G90\nG1 X2 F3000\nG3 X2 Y2 I0 J1\nG1 X0\nG1 Y0\n"


@pytest.fixture(scope="session")
def whole_tour(tmp_path_factory):
    return Tour(tmp_path_factory.mktemp("tour"), two_axes(MACHINE), PART)


@pytest.fixture
def tour(whole_tour, monkeypatch):
    """Name of a stop -> what its command left; the test runs in the folder of the tour.

    See `tests.app.tour`.
    """
    monkeypatch.chdir(whole_tour.folder)
    return whole_tour


@pytest.fixture(scope="session")
def inputs(tmp_path_factory):
    return tmp_path_factory.mktemp("inputs")


@pytest.fixture(scope="session")
def machine_fields():
    return two_axes(MACHINE)


@pytest.fixture(scope="session")
def machine_file(inputs, machine_fields):
    path = inputs / "machine.json"
    path.write_text(json.dumps(machine_fields))
    return path


@pytest.fixture(scope="session")
def part_file(inputs):
    path = inputs / "part.ngc"
    path.write_text(PART)
    return path

"""Limits of controls from their own files, with their units; faults in one line."""

import numpy as np
import pytest

from jcontour.app.files.checks import MachineError
from jcontour.app.files.control_limits import read_control_limits

INI = """[RS274NGC]
RS274NGC_STARTUP_CODE = G21 G90 G64 P0.005
[KINS]
KINEMATICS = trivkins coordinates=XYZ
[TRAJ]
LINEAR_UNITS = mm
MAX_LINEAR_VELOCITY = 150
[HAL]
HALFILE = a.hal
HALFILE = b.hal
[AXIS_X]
MAX_VELOCITY = 200
MAX_ACCELERATION = 3000
[AXIS_Y]
MAX_VELOCITY = 100  # slower
MAX_ACCELERATION = 2000
"""
GRBL = """$10=1
$11=0.020
$12=0.003
$110=5000.000
$111=4000.000 (y max rate, mm/min)
$120=500.000
$121=400.000
"""


def limits(tmp_path, text, axes=2):
    path = tmp_path / "file.cfg"
    path.write_text(text)
    return read_control_limits(path, axes)


def test_linuxcnc(tmp_path):
    limits_read, warnings = limits(tmp_path, INI)
    np.testing.assert_allclose(limits_read.speed, [0.2, 0.1])
    np.testing.assert_allclose(limits_read.acceleration, [3.0, 2.0])
    assert (limits_read.control, limits_read.path_speed, limits_read.tolerance) == (
        "linuxcnc",
        0.15,
        5e-6,
    )
    assert warnings == ()
    inches, warnings = limits(tmp_path, INI.replace("= mm", "= inch"))
    np.testing.assert_allclose(inches.speed, [5.08, 2.54])
    assert "[AXIS_X] MAX_VELOCITY = 200 is read as inches a second, 304800 mm/min" in warnings[0]


def test_grbl(tmp_path):
    limits_read, warnings = limits(tmp_path, GRBL)
    np.testing.assert_allclose(limits_read.speed, [5 / 60, 4 / 60])
    np.testing.assert_allclose(limits_read.acceleration, [0.5, 0.4])
    assert (limits_read.control, limits_read.junction_deviation) == ("grbl", 20e-6)
    assert limits_read.arc_tolerance == pytest.approx(3e-6) and warnings == ()


def test_units_that_look_wrong_are_questioned(tmp_path):
    assert (
        "5000 is read as mm/s, 300000 mm/min" in limits(tmp_path, INI.replace("200", "5000"))[1][0]
    )
    assert (
        "83 is read as mm/min, 1.38 mm/s" in limits(tmp_path, GRBL.replace("5000.000", "83"))[1][0]
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (INI.replace("MAX_VELOCITY = 100  # slower\n", ""), r"\[AXIS_Y\] MAX_VELOCITY is missing"),
        (INI.replace("= 2000", "= fast"), r"\[AXIS_Y\] MAX_ACCELERATION needs a number above 0"),
        (INI.replace("trivkins coordinates=XYZ", "maxkins"), r"'maxkins': its joints are not its"),
        (INI.replace("LINEAR_UNITS = mm\n", ""), r"\[TRAJ\] LINEAR_UNITS needs mm or inch"),
        (GRBL.replace("$121=400.000\n", ""), r"\$121 is missing"),
        (GRBL.replace("$120=500.000", "$120=0"), r"\$120 needs a number above 0, received '0'"),
        ("[other]\na = 1\n", r"no \[TRAJ\] of a LinuxCNC INI, no \$110"),
        ("G1 X1\n", r"no INI or listing of grbl"),
    ],
)
def test_faults_are_told_in_one_line(tmp_path, text, message):
    with pytest.raises(MachineError, match=message) as caught:
        limits(tmp_path, text)
    assert len(str(caught.value).splitlines()) == 1 and "file.cfg: " in str(caught.value)

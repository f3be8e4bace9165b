"""Components and configuration for LinuxCNC, without running it."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from jcontour.export.linuxcnc import DRIVE, linuxcnc_files, stock_pids
from jcontour.linear.plant import LinearPlant
from jcontour.plants import exact_bridgeport
from jcontour.plants.actuation import with_dry_friction

from .conftest import code_of

COUNT, ACCELERATION = np.full(2, 1e-6), np.full(2, 3.0)


def files(code, axes=("X", "Y"), display="axis", **more):
    return linuxcnc_files(
        code, exact_bridgeport(), COUNT, axes, ACCELERATION, "law", display, **more
    )


def test_every_joint_is_wired_and_has_its_limits():
    actual = files(code_of("contouring"), ("X", "Z"))
    hal, ini = actual["loop.hal"], actual["machine.ini"]
    for joint, axis in enumerate("XZ"):
        assert f"net command-{axis} joint.{joint}.motor-pos-cmd" in hal
        assert f"[AXIS_{axis}]" in ini and f"[JOINT_{joint}]" in ini
    assert "SERVO_PERIOD = 500000\n" in ini and "MAX_ACCELERATION = 3000.0" in ini
    assert "drive.py" not in actual and "sampler" not in hal
    assert "drive.py" in files(code_of("contouring"), display=DRIVE)
    assert "typedef double real;" in files(code_of("contouring", "single"))["law.h"]


@pytest.mark.skipif(not shutil.which("halcompile"), reason="halcompile is not installed")
@pytest.mark.parametrize("name", ["contouring", "preview"])
def test_both_components_compile(name, tmp_path):
    for file, text in files(code_of(name)).items():
        (tmp_path / file).write_text(text)
    for component in ("jcontour_law", "jcontour_machine"):
        words = ["halcompile", "--compile", f"{component}.comp"]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / f"{component}.so").exists()


def test_the_machine_has_its_friction():
    table = exact_bridgeport()
    rubbed = with_dry_friction(table, np.asarray(table.B), np.array([0.25, 0.5]))
    code = code_of("contouring")
    text = linuxcnc_files(code, rubbed, COUNT, ("X", "Y"), ACCELERATION, "law")
    assert "FRICTION[2] = {\n    0.25, 0.5\n};" in text["jcontour_machine.comp"]


def test_what_linuxcnc_cannot_run_is_told():
    code = code_of("contouring")
    quick = replace(code, law=replace(code.law, dt=2e-5))
    for wrong, axes, words in (
        (code, ("X", "Y1"), "joints have to be axes"),
        (code, ("X", "X"), "joints have to be axes"),
        (quick, ("X", "Y"), "shorter than a servo period"),
        (code_of("state"), ("X", "Y"), "needs an encoder for each of the 2 axes"),
    ):
        with pytest.raises(ValueError, match=words):
            files(wrong, axes)


def test_a_pid_is_tuned_at_the_edge_of_stability():
    """A slide behind a sample of delay, p = K v at once: it oscillates at K = 1 / dt."""
    dt = 1e-3
    slide = LinearPlant([[1.0, 1e-3 * dt], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], dt)
    (pid,) = stock_pids(slide, np.array([10.0]))
    # z^2 - z + K dt = 0 has its roots on the unit circle at K dt = 1, at 60 degrees a sample
    assert pid.P == pytest.approx(0.6 / dt, rel=1e-6)
    assert (pid.I, pid.D) == pytest.approx((1.2 / dt / (6 * dt), 0.075 / dt * 6 * dt), rel=1e-5)
    assert pid.FF1 == pytest.approx(1.0, rel=1e-9)
    (through,) = stock_pids(LinearPlant([[0.9]], [[0.05]], [[1.0]], dt), np.ones(1))  # 500 mm
    assert (through.P, through.FF0) == (0.0, pytest.approx(2e-3))

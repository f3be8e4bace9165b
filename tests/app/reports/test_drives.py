"""Gains of a drive do the same under the names of every product."""

import numpy as np
import pytest

from jcontour.app.reports.drives import PRODUCTS, drive_gains

CASCADE = {"position": 20.0, "velocity": 3.0, "integral_time": 0.0125, "feedforward": 0.9}
CASCADE |= {"viscous": 0.4, "inertia": 0.02}


def numbers(weights, drive):
    lines = [
        line for line in drive_gains(weights, "V", drive) if not line.startswith(("lead", "with"))
    ]
    return {line.split()[0]: float(line.split()[1]) for line in lines}


def test_general_terms_have_the_units_of_drives():
    """20 1/s is 1.2 m/min per mm; a full velocity feedforward is not named."""
    weights = {"position": 20.0, "integral_time": 0.0125, "feedforward": 1.0}
    weights |= {"velocity": np.array([3.0, 4.0]), "notch": np.full(2, 2 * np.pi * 45)}
    assert drive_gains(weights, "V") == [
        "position gain 20 1/s (1200 mm/min per mm)",
        "velocity gain 3, 4 V per m/s",
        "integral time 12.5 ms",
        "notch 45 Hz",
    ]


def test_a_pid_controller_of_the_position_error_does_the_same():
    """Both answer any sines of reference and position alike."""
    gains = numbers(CASCADE, "linuxcnc-pid")
    p, i, d, ff0, ff1, ff2 = (
        1e3 * gains[name] for name in ("Pgain", "Igain", "Dgain", "FF0", "FF1", "FF2")
    )  # per m
    one = CASCADE
    for w in (3.0, 40.0, 500.0):
        s, r, y = 1j * w, 1.0 + 0.5j, 0.8 - 0.1j
        speed = one["position"] * (r - y) + one["feedforward"] * s * r - s * y
        wanted = one["velocity"] * (1 + 1 / (one["integral_time"] * s)) * speed
        wanted += one["viscous"] * s * r + one["inertia"] * s**2 * r
        made = (p + i / s + d * s) * (r - y) + (ff0 + ff1 * s + ff2 * s**2) * r
        assert made == pytest.approx(wanted, rel=1e-3)  # four digits are printed


def test_a_proportional_loop_as_a_pid_controller():
    """u = k_v (k_p e + v_r) + k_a a_r."""
    gains = numbers({"position": 18.0, "viscous": 50.0, "inertia": 1.5}, "linuxcnc-pid")
    assert gains.pop("error-previous-target") == 0  # e of the present command
    assert gains == pytest.approx({"Pgain": 0.9, "FF1": 0.05, "FF2": 1.5e-3})


def test_a_kv_of_one_lags_by_a_millimetre_at_a_metre_a_minute():
    """20 1/s lags by v / 20 s."""
    lag = 1e3 * (1 / 60) / CASCADE["position"]  # [mm] at 1 m/min
    for drive in ("siemens", "beckhoff"):
        name, *_, value, unit = drive_gains(CASCADE, "N", drive)[0].split()
        assert name in ("MD32200", "S-0-0104") and unit == "1000/min"
        assert float(value) == pytest.approx(1 / lag)
    assert drive_gains(CASCADE, "N", "beckhoff")[1] == "S-0-0296 velocity feedforward 90 %"


@pytest.mark.parametrize(("unit", "torque"), [("N", 5e-3 / (2 * np.pi)), ("Nm", 1.0)])
def test_a_screw_of_5_mm_takes_the_same_torque(unit, torque):
    """Of a speed error of 3 turns a second, by the gain per turn/s or per rad/s."""
    lead, turns = 5e-3, 3.0
    wanted = torque * CASCADE["velocity"] * lead * turns  # Nm

    def gain(drive, name):
        line = next(line for line in drive_gains(CASCADE, unit, drive) if line.startswith(name))
        factor = line.split("times ")[1].split(":")[0].replace("^", "**").replace(" pi", " * pi")
        value = float(line.removeprefix(name).split()[0])
        return value * eval(factor, {"lead": lead, "pi": np.pi})

    assert gain("odrive", "vel_gain") * turns == pytest.approx(wanted)
    radians = 2 * np.pi * turns
    assert gain("siemens", "p1460 speed controller P gain") * radians == pytest.approx(wanted)
    assert gain("beckhoff", "S-0-0100 velocity loop gain") * radians == pytest.approx(wanted)
    integral = gain("odrive", "vel_integrator_gain") * turns
    assert integral == pytest.approx(wanted / CASCADE["integral_time"])


def test_torque_per_unit_of_other_commands_is_asked_for():
    lines = drive_gains(CASCADE, "A", "odrive")
    assert lines[1] == "vel_gain 3 A per m/s; times lead (Nm per A): Nm/(turn/s)"
    assert "lead: travel of the axis in one turn of the motor [m]" in lines


@pytest.mark.parametrize("drive", PRODUCTS)
def test_no_gain_is_lost_in_silence(drive):
    """What a product has no parameter for is named."""
    weights = CASCADE | {"notch": 300.0, "depth": 0.2, "notch_damping": 0.3}
    printed = " ".join(drive_gains(weights, "V", drive))
    assert printed.count("notch") + printed.count("filter") + printed.count("p16") >= 3
    assert "0.02 V per m/s^2" in printed or drive == "linuxcnc-pid"

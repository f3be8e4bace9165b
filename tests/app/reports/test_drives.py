"""Gains of a drive do the same under the names of every product."""

import numpy as np
import pytest

from jcontour.app.reports.drives import PRODUCTS, drive_gains

CASCADE = {"position": 20.0, "velocity": 3.0, "integral_time": 0.0125, "feedforward": 0.9}
CASCADE |= {"viscous": 0.4, "inertia": 0.02}


def numbers(weights, drive):
    lines = [line for line in drive_gains(weights, "V", drive) if ":" not in line]
    return {line.split()[0]: float(line.split()[1]) for line in lines}


def test_general_terms_have_the_units_of_drives():
    """20 1/s is 1.2 m/min per mm; a full velocity feedforward is not named."""
    weights = {"position": 20.0, "integral_time": 0.0125, "feedforward": 1.0}
    weights |= {"velocity": np.array([3.0, 4.0]), "notch": np.full(2, 2 * np.pi * 45)}
    assert drive_gains(weights, "V") == [
        "position gain 20 1/s (1200 mm/min per mm)",
        "velocity gain 3, 4 V s/m",
        "integral time 12.5 ms",
        "notch 45 Hz",
    ]


def test_a_pid_controller_of_the_position_error_does_the_same():
    """Both answer any sines of reference and position alike."""
    found = numbers(CASCADE, "linuxcnc-pid")
    p, i, d, ff0, ff1, ff2 = (
        1e3 * found[name] for name in ("Pgain", "Igain", "Dgain", "FF0", "FF1", "FF2")
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
    found = numbers({"position": 18.0, "viscous": 50.0, "inertia": 1.5}, "linuxcnc-pid")
    assert found == pytest.approx({"Pgain": 0.9, "FF1": 0.05, "FF2": 1.5e-3})


def test_units_of_the_products():
    assert drive_gains(CASCADE, "A", "siemens")[0] == "MD32200 POSCTRL_GAIN 1.2 1000/min"
    assert drive_gains(CASCADE, "A", "beckhoff")[:2] == [
        "S-0-0104 position loop Kv 1.2 1000/min",
        "S-0-0296 velocity feedforward 90 %",
    ]
    assert numbers(CASCADE, "odrive")["vel_integrator_gain"] == pytest.approx(240.0)


@pytest.mark.parametrize("drive", PRODUCTS)
def test_no_gain_is_lost_in_silence(drive):
    """What a product has no parameter for is named."""
    weights = CASCADE | {"notch": 300.0, "depth": 0.2, "notch_damping": 0.3}
    printed = " ".join(drive_gains(weights, "V", drive))
    assert printed.count("notch") + printed.count("filter") + printed.count("p16") >= 3
    assert "0.02 V s^2/m" in printed or drive == "linuxcnc-pid"

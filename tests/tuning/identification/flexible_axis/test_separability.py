"""Parameters that are not separated, and the experiments that separate them."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.plants.flexible_axis.axis import thesis_axis
from jcontour.plants.flexible_axis.linear_motor import thesis_motor
from tuning.identification.estimates import Estimate
from tuning.identification.flexible_axis.axis import identify
from tuning.identification.flexible_axis.commissioning import Commissioning, Passes
from tuning.identification.flexible_axis.separability import (
    notes,
    separated,
    stribeck_separated,
    telling_speed,
    tool_separated,
    unseparated,
)


def test_what_counts_as_separated():
    one = Estimate(("a", "b"), np.array([-10.0, 10.0]), np.diag([1.2**2, 1.4**2]))
    assert separated(one, "a") and not separated(
        one, "b"
    )  # 1.96 x 1.2 is below a quarter of 10, 1.96 x 1.4 is not


@pytest.mark.slow
def test_normal_speeds_do_not_separate_the_parts_of_friction(found):
    assert not stribeck_separated(found.estimate) and tool_separated(found.estimate)
    assert unseparated(found.estimate) == {"coulomb", "stribeck", "stribeck_speed"}
    (note,) = found.notes
    assert note.startswith(
        "coulomb, stribeck, stribeck_speed: not separated by speeds up to 0.36 m/s"
    )
    # the same values with a damper and a mass that are known to half of themselves only
    covariance = found.estimate.covariance.copy()
    for name in ("damping_per_mass", "total_mass"):
        k = found.estimate.names.index(name)
        covariance[k, k] = (0.25 * found.estimate.values[k]) ** 2
    vague = replace(found.estimate, covariance=covariance)
    more = {"damping_per_mass", "total_mass", "motor_mass"}
    assert unseparated(vague) == more | {"coulomb", "stribeck", "stribeck_speed"}
    said = " ".join(notes(vague, found.forces))
    assert "total_mass: not separated; runs up to speed at a higher acceleration would tell" in said
    assert "damping_per_mass: not separated; sharper moves" in said
    names = np.array(found.estimate.names)
    pushed = np.where(names == "constant_force", -5.0, found.estimate.values)
    said = notes(replace(found.estimate, values=pushed), found.forces)
    assert any(note.startswith("constant_force: -5 N help one way") for note in said)


@pytest.mark.parametrize("break_away", [0.0, -3.0])
def test_without_a_break_away_force_the_least_speed_is_proposed(break_away):
    """There is nothing to guess the fall of the friction from."""
    one = Estimate(("break_away", "drop"), np.array([break_away, 2.0]), np.diag([0.1, 0.1]))
    assert telling_speed(one, 0.4) == pytest.approx(0.6)


def test_the_speed_proposed_grows_with_the_fourth_root_of_what_is_not_known():
    """The deviation of the next term falls with the fourth power of the speed."""
    names, values = ("break_away", "drop"), np.array([58.4, 2.77])
    known, vague = (Estimate(names, values, np.diag([0.1, s**2])) for s in (0.05, 0.8))
    assert telling_speed(known, 0.2) > 1.5 * 0.2
    assert telling_speed(vague, 0.2) == pytest.approx(2 * telling_speed(known, 0.2))


@pytest.mark.slow
def test_the_sweep_asked_for_separates_them(found, records):
    """The note's speed and half of it are added to the sweep, on a travel that is long enough."""
    speed = telling_speed(found.estimate, found.forces.fastest)
    assert 0.5 < speed < 2.82
    law = Passes(3.0, (0.1, 0.5 * speed, speed, speed), pause=0.1)
    fast = Commissioning(thesis_axis(), thesis_motor(), seed=5).motion("fast sweep", law)
    again = identify([*records, fast])
    assert stribeck_separated(again.estimate) and not again.notes
    for name, truth in (("coulomb", 36.36), ("stribeck", 22.04), ("stribeck_speed", 2.82)):
        low, high = again.estimate.interval(name)
        assert low - (high - low) / 2 < truth < high + (high - low) / 2, name

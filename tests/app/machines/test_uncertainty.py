"""What is not known about a machine: what is assumed, stated and refused."""

import numpy as np
import pytest

from jcontour.app.files.checks import MachineError
from jcontour.app.machines.uncertainty import (
    assumed,
    family_members,
    random_members,
    stated_uncertainty,
)
from jcontour.linear.plant import LinearPlant

DT = 1e-3


def drives(pole, gain):
    return LinearPlant(pole * np.eye(2), gain * np.eye(2), np.eye(2), DT)


SPEED, POSITION = drives(1.0, DT), drives(0.9, 0.1)


def test_a_file_that_states_nothing_has_the_usual():
    assert stated_uncertainty(None, SPEED) == (0.1, 1, None)
    assert stated_uncertainty(None, POSITION) == (0.0, 1, None)  # its own encoder is followed
    assert stated_uncertainty({}, SPEED) == (0.0, 0, None)
    assert stated_uncertainty({"gain": 0.2, "delay": 3}, POSITION) == (0.2, 3, None)


def test_frequencies_are_stated_in_hertz():
    given = {"hertz": [10.0, 250.0], "relative": [[0.1, 0.2], [0.3, 0.4]]}
    doubt = stated_uncertainty({"response": given}, SPEED).response
    assert doubt is not None
    np.testing.assert_allclose(doubt.frequency, [0.02 * np.pi, 0.5 * np.pi])
    np.testing.assert_array_equal(doubt.relative, [[0.1, 0.3], [0.2, 0.4]])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"gain": 1.0}, "uncertainty.gain: needs to be less than 1"),
        ({"delay": 51}, "uncertainty.delay: needs to be less than or equal to 50"),
        ({"mass": 0.1}, "uncertainty: there is no field 'mass'"),
        ("none", "uncertainty"),
    ],
)
def test_what_is_impossible_is_refused(given, says):
    with pytest.raises(MachineError, match=says):
        stated_uncertainty(given, SPEED)


def test_gains_are_off_in_opposite_ways():
    members = family_members(3, 0.1, 2)
    assert [one.late for one in members] == [0, 0, 0, 1, 2]
    np.testing.assert_allclose(members[1].gains, [1.1, 0.9, 1.1])
    np.testing.assert_allclose(members[2].gains, [0.9, 1.1, 0.9])
    assert [one.name for one in family_members(2, 0.0, 1)] == ["nominal", "1 sample late"]


def test_random_gains_and_delays_fill_their_intervals():
    names, gains, delays = zip(*random_members(400, 0, 2, 0.1, 2), strict=True)
    assert 0.09 < np.abs(np.array(gains) - 1).max() <= 0.1 + 1e-12
    assert 0 <= min(delays) < 0.1 and 1.9 < max(delays) <= 2
    assert names[-1] == "gains 1.1, 1.1, 2 samples late"


def test_the_line_of_what_is_assumed():
    line = assumed("mill", 0.1, 1, "UNCERTAINTY =")
    assert "gains 10 % off both ways and a sample of delay more" in line
    assert "gains" not in assumed("mill", 0.0, 1, "UNCERTAINTY =").split(";")[0]

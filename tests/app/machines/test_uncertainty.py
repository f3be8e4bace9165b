"""What is not known about a machine: what is assumed, stated and refused."""

import numpy as np
import pytest

from jcontour.app.files.checks import MachineError
from jcontour.app.machines import uncertainty
from jcontour.app.machines.from_file import stated_uncertainty
from jcontour.linear.continuous_axes import speed_axis, with_resonance
from jcontour.linear.plant import LinearPlant

DT = 1e-3


def drives(pole, gain):
    return LinearPlant(pole * np.eye(2), gain * np.eye(2), np.eye(2), DT)


SPEED, POSITION = drives(1.0, DT), drives(0.9, 0.1)


def test_a_file_that_states_nothing_has_the_usual():
    assert stated_uncertainty(None, SPEED) == (0.1, 1, None, uncertainty.IN_FILE)
    assert stated_uncertainty(None, POSITION) == (
        0.0,
        1,
        None,
        uncertainty.IN_FILE,
    )  # its own encoder is followed
    assert stated_uncertainty({}, SPEED) == (0.0, 0, None, "")
    assert stated_uncertainty({"gain": 0.2, "delay": 3}, POSITION) == (0.2, 3, None, "")


def test_frequencies_are_stated_in_hertz():
    given = {"hertz": [10.0, 250.0], "relative": [[0.1, 0.2], [0.3, 0.4]]}
    response = stated_uncertainty({"response": given}, SPEED).response
    assert response is not None
    np.testing.assert_allclose(response.frequency, [0.02 * np.pi, 0.5 * np.pi])
    np.testing.assert_array_equal(response.relative, [[0.1, 0.3], [0.2, 0.4]])


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
    members = uncertainty.family_members(3, uncertainty.Uncertainty(0.1, 2))
    assert [one.late for one in members] == [0, 0, 0, 1, 2]
    np.testing.assert_allclose(members[1].gains, [1.1, 0.9, 1.1])
    np.testing.assert_allclose(members[2].gains, [0.9, 1.1, 0.9])
    assert [one.name for one in uncertainty.family_members(2, uncertainty.Uncertainty(0.0, 1))] == [
        "nominal",
        "1 sample late",
    ]


def test_random_gains_and_delays_fill_their_intervals():
    names, gains, delays = zip(
        *uncertainty.random_members(400, 0, 2, uncertainty.Uncertainty(0.1, 2)), strict=True
    )
    assert 0.09 < np.abs(np.array(gains) - 1).max() <= 0.1 + 1e-12
    assert 0 <= min(delays) < 0.1 and 1.9 < max(delays) <= 2
    assert names[-1] == "gains 1.1, 1.1, 2 samples late"


def test_the_line_of_what_is_assumed():
    line = uncertainty.assumed("mill", 0.1, 1, "UNCERTAINTY =")
    assert "gains 10 % off both ways and a sample of delay more" in line
    assert "gains" not in uncertainty.assumed("mill", 0.0, 1, "UNCERTAINTY =").split(";")[0]


HERTZ, Z = 80.0, 0.03


def ring(hertz, damping, places):
    """Response of a whole axis with the resonance."""
    axis = with_resonance(speed_axis(1.0, 0.02, 1.5e-3), 2 * np.pi * hertz, damping)
    return axis.response(2 * np.pi * places)


@pytest.mark.parametrize("part", [0.02, 0.1])
def test_every_resonance_that_there_may_be_is_inside_and_one_is_at_the_edge(part):
    field = uncertainty.unsure_resonances((0.0, HERTZ), Z, part, DT)
    places, relative = np.array(field["hertz"]), np.array(field["relative"])
    assert np.all(np.diff(places) > 0) and places[-1] < 500 and places[0] == HERTZ / 10
    assert not relative[0].any()
    random = np.random.default_rng(0)
    drawn = zip(random.uniform(-part, part, 40), random.uniform(0.5, 1, 40), strict=True)
    corners = [(side * part, damped) for side in (-1, 1) for damped in (0.5, 1.0)]
    said = ring(HERTZ, Z, places)
    off = np.array(
        [np.abs(ring(HERTZ * (1 + s), Z * d, places) / said - 1) for s, d in [*corners, *drawn]]
    )
    assert np.all(off <= 1.03 * relative[1] + 1e-3)  # between those that are tried
    far = (places < HERTZ / 2) | (places > 2 * HERTZ)  # there an end of the interval is worst
    assert np.allclose(off[:4, far].max(axis=0), relative[1, far], rtol=1e-3)


def test_resonances_of_both_axes_are_told_at_the_places_of_both():
    both = uncertainty.unsure_resonances((60.0, HERTZ), Z, 0.05, DT)
    alone = uncertainty.unsure_resonances((60.0, 0.0), Z, 0.05, DT)
    at = np.array(both["relative"])[0, np.isin(both["hertz"], alone["hertz"])]
    assert np.allclose(at, alone["relative"][0]) and len(both["hertz"]) > len(alone["hertz"])


def test_it_is_what_rounding_leaves_of_a_position_that_moves():
    """Even within half a count: its deviation is resolution / sqrt(12), and it is white."""
    noise = np.asarray(uncertainty.rounding_noise(2, 3e-6)) / 3e-6
    assert noise.shape == (uncertainty.SAMPLES, 2) and np.abs(noise).max() <= 0.5
    np.testing.assert_allclose(noise.std(axis=0), 1 / np.sqrt(12), rtol=0.03)
    assert np.abs(noise.mean(axis=0)).max() < 4 / np.sqrt(12 * uncertainty.SAMPLES)
    correlation = np.mean(noise[1:] * noise[:-1], axis=0) * 12
    assert np.abs(correlation).max() < 4 / np.sqrt(uncertainty.SAMPLES)
    assert abs(np.mean(noise[:, 0] * noise[:, 1])) * 12 < 4 / np.sqrt(uncertainty.SAMPLES)


def test_every_position_has_its_own_count():
    mixed, fine, coarse = (
        np.asarray(uncertainty.rounding_noise(2, counts))
        for counts in (np.array([1e-6, 5e-6]), 1e-6, 5e-6)
    )
    np.testing.assert_array_equal(mixed, np.stack([fine[:, 0], coarse[:, 1]], axis=1))
    assert mixed.std(axis=0) == pytest.approx(np.array([1e-6, 5e-6]) / np.sqrt(12), rel=0.03)


def test_sensors_have_white_noise_with_a_bound():
    noise = np.asarray(uncertainty.sensor_noise(2, np.array([3e-7, 0.0])))
    assert noise.shape == (uncertainty.SAMPLES, 2) and not noise[:, 1].any()
    scaled = noise[:, 0] / 3e-7
    assert np.abs(scaled).max() == pytest.approx(uncertainty.FARTHEST)  # of 8192 some 22 are beyond
    assert scaled.std() == pytest.approx(1.0, rel=0.03)
    assert abs(np.mean(scaled[1:] * scaled[:-1])) < 4 / np.sqrt(uncertainty.SAMPLES)

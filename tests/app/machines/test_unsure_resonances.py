import numpy as np
import pytest

from jcontour.app.machines.unsure_resonances import unsure_resonances
from jcontour.linear.continuous_axes import speed_axis, with_resonance

DT, HERTZ, Z = 1e-3, 80.0, 0.03


def ring(hertz, damping, places):
    """Response of a whole axis with the resonance."""
    axis = with_resonance(speed_axis(1.0, 0.02, 1.5e-3), 2 * np.pi * hertz, damping)
    return axis.response(2 * np.pi * places)


@pytest.mark.parametrize("part", [0.02, 0.1])
def test_every_resonance_that_there_may_be_is_inside_and_one_is_at_the_edge(part):
    field = unsure_resonances((0.0, HERTZ), Z, part, DT)
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
    both = unsure_resonances((60.0, HERTZ), Z, 0.05, DT)
    alone = unsure_resonances((60.0, 0.0), Z, 0.05, DT)
    at = np.array(both["relative"])[0, np.isin(both["hertz"], alone["hertz"])]
    assert np.allclose(at, alone["relative"][0]) and len(both["hertz"]) > len(alone["hertz"])

"""Margins over several training paths: which of them is named, and which has none."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.stability import Margins
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.reports.tuned_tables import lost_first_line
from jcontour.app.runs.checks.weights.path_margins import lost_first, path_margins
from jcontour.app.runs.tuning.family_loops import family_peaks
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import line
from jcontour.motion.references import along
from jcontour.plants.wrappers.delays import Delayed
from jcontour.plants.wrappers.saturation import Saturated
from jcontour.simulation.evaluation import stack_references

PATHS = [
    along(line([x, 0.0], [x + 1e-2, 0.0]), 1e-3 * np.arange(5), 1e-3, 0, at_rest=False)
    for x in (0.0, 0.5)
]
WIDE = Margins(0.9, np.array([[0.05, 20.0], [0.05, 3.0]]), np.array([[-1, -1], [-1, 2]]), 2, 0)


@pytest.mark.parametrize(
    ("gain", "samples", "wanted"),
    [
        (
            [[0.05, 20.0], [0.5, 20.0]],
            [[-1, -1], [3, -1]],
            ("right", 2, [0.503, 0.0]),
        ),  # halved is nearer than three times
        ([[0.05, 1.5], [0.5, 20.0]], [[-1, 4], [3, -1]], ("right", 1, [0.504, 0.0])),
        ([[0.05, 20.0], [0.05, 20.0]], [[-1, -1], [-1, -1]], ("left", 2, [0.002, 0.0])),
        ([[0.05, 20.0], [0.05, 2.0]], [[-1, -1], [-1, -1]], None),  # its loops are lost all at once
    ],
)
def test_the_smallest_gain_margin_is_named(gain, samples, wanted):
    place = lost_first(
        [WIDE, Margins(0.9, np.array(gain), np.array(samples), 2, 0)], PATHS, ["left", "right"]
    )
    if wanted is None:
        assert place is None
    else:
        assert (place.contour, place.input) == wanted[:2]
        np.testing.assert_allclose(place.position, wanted[2], rtol=0, atol=1e-12)
        x = 1e3 * wanted[2][0]
        assert lost_first_line(place, ["X", "Y"]).endswith(
            f"input {wanted[1]}, on {wanted[0]} where the reference is at X {x:g}, Y 0 mm"
        )


@pytest.mark.slow
def test_a_path_that_is_run_at_the_limit_all_along_has_no_margins(two_axes):
    """Along the first path nothing moves; along the second the control is always at its limit."""
    arcs = [np.zeros(30), 1e-3 * np.arange(1, 31), 1e-3 * np.arange(30)]
    references = [
        along(line([0.0, 0.0], [1.0, 0.0]), arc, two_axes.dt, 3, at_rest=True) for arc in arcs
    ]
    jobs = tuple(SimpleNamespace(name=name) for name in ("still", "hasty", "other"))
    scenarios = Scenarios(
        jobs, (True, True, False), ("nominal",), stack_references(references), two_axes
    )  # type: ignore[arg-type]
    plant = Delayed(Saturated(two_axes, jnp.full(2, 1e-3)), jnp.asarray(0), 1, 2)
    machine, law = (
        SimpleNamespace(nominal=lambda fed: plant, smooth_family=lambda fed: [plant], doubt=None),
        ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3),
    )
    tried = law, machine, scenarios, "state"
    peaks = family_peaks(*tried)  # type: ignore[arg-type]
    found = path_margins(*tried, peaks)  # type: ignore[arg-type]
    assert found.contours_without_margins == ("hasty",) and found.probes_left_out == 0
    one = scenarios._replace(training=(True, False, False))
    calm = path_margins(law, machine, one, "state", peaks)  # type: ignore[arg-type]
    assert calm.contours_without_margins == () and calm.spectral_radius < 1

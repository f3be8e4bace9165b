from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.flexible_axis.axis import thesis_axis
from tuning.identification.estimates import Estimate
from tuning.identification.flexible_axis.axis import _left_out, _parameters, _together, identify
from tuning.identification.flexible_axis.cogging import Harmonics, Spectrum
from tuning.identification.flexible_axis.forces import ForceFit
from tuning.identification.flexible_axis.records import Record

TRUTH = {
    "resistance": 12.51,
    "inductance": 10.7e-3,
    "back_emf": 52.89,
    "force_constant": 1.5 * 52.89,
    "total_mass": 40.0,
    "motor_mass": 39.62,
    "tool_mass": 0.38,
    "stiffness_per_mass": 2908.0 / 0.38,
    "damping_per_mass": 2.1 / 0.38,
    "stiffness": 2908.0,
    "damping": 2.1,
    "break_away": 58.4,
    "viscous": 250.9,
    "drop": 22.04 / 2.82**2,
    "pole_pitch": 0.0875,
    "sine_1": 4.07,
    "sine_2": 0.95,
    "sine_3": -0.72,
    "cosine_1": 9.20,
    "cosine_2": -0.26,
    "cosine_3": 0.57,
    "amplitude_1": np.hypot(4.07, 9.20),
    "amplitude_2": np.hypot(0.95, 0.26),
    "amplitude_3": np.hypot(0.72, 0.57),
}
WITHIN = {  # relative: what the issue of this demonstration asks for, or better
    "force_constant": 0.01,
    "viscous": 0.01,
    "total_mass": 0.01,
    "break_away": 0.01,
    "stiffness_per_mass": 0.001,
    "damping_per_mass": 0.01,
}


@pytest.mark.slow
def test_the_thesis_axis_is_found_again(found):
    """Within a few per cent, no error beyond four deviations, and the model is of the estimate."""
    for name, tolerance in WITHIN.items():
        assert found.estimate[name] == pytest.approx(TRUTH[name], rel=tolerance), name
    for j in (1, 2, 3):
        assert found.estimate[f"amplitude_{j}"] == pytest.approx(
            TRUTH[f"amplitude_{j}"], rel=0.03
        ), j
    for name, truth in TRUTH.items():
        assert abs(found.estimate[name] - truth) < 4 * found.estimate.deviation(name), name
    p, value = found.parameters, found.estimate
    for name in ("motor_mass", "tool_mass", "stiffness", "damping", "force_constant", "pole_pitch"):
        assert float(getattr(p, name)[0]) == pytest.approx(value[name], rel=1e-12), name
    np.testing.assert_array_equal(p.cogging_sine[0], [value[f"sine_{j}"] for j in (1, 2, 3)])
    # friction is right up to the fastest speed of the data, although its parts are not known
    for speed in (0.0, 0.1, 0.2, 0.35):
        forward = jnp.array([1]), jnp.array([speed])
        truth = thesis_axis().friction.slipping(*forward)
        np.testing.assert_allclose(p.friction.slipping(*forward), truth, rtol=3e-3)


@pytest.mark.slow
def test_an_end_effector_lighter_than_nothing_still_makes_a_model(found):
    """As noise may have it: the resonance stays, the mass is a thousandth of the whole."""
    values = np.where(np.array(found.estimate.names) == "tool_mass", -0.1, found.estimate.values)
    p = _parameters(replace(found.estimate, values=values), found.forces)
    total = found.estimate["total_mass"]
    assert float(p.tool_mass[0]) == pytest.approx(1e-3 * total) and float(
        (p.tool_mass + p.motor_mass)[0]
    ) == pytest.approx(total)
    assert float((p.stiffness / p.tool_mass)[0]) == pytest.approx(
        found.estimate["stiffness_per_mass"]
    )


def test_physical_parameters_are_those_of_the_balance():
    """Friction f_0 + b v - q v^2 / (1 + w v^2) is that of Stribeck: 1 / (1 + (v / v_s)^2)."""
    names = ("break_away", "viscous", "drop", "curvature", "total_mass")
    stribeck, speed, coulomb = 22.04, 2.82, 36.36
    values = np.array([coulomb + stribeck, 250.9, stribeck / speed**2, speed**-2, 40.0])
    balance = Estimate(names, values, np.eye(5))
    cogging = Harmonics(0.0875, 0)
    forces = ForceFit(balance, [], [], Spectrum(np.zeros(1), np.zeros(1), 1.0), cogging)
    scale = Estimate(("force_constant",), np.array([79.0]), np.ones((1, 1)))
    found = _together(scale, None, forces)
    assert found["stribeck"] == pytest.approx(stribeck)
    assert found["stribeck_speed"] == pytest.approx(speed)
    assert found["coulomb"] == pytest.approx(coulomb)
    # a force scale that is one per cent off moves all forces and masses by as much
    assert found.deviation("total_mass") == pytest.approx(np.hypot(1.0, 40.0 / 79.0))


ROW = np.zeros(200)
ELECTRICAL, BARE = Record("a", 1e-3, ROW, ROW, voltage=ROW), Record("bare", 1e-3, ROW, ROW)


@pytest.mark.parametrize(
    ("records", "given", "says"),
    [
        ([BARE], {}, "needs an electrical test .* or its value, and not both"),
        ([ELECTRICAL, BARE], {"force_constant": 79.0}, "and not both"),
        ([ELECTRICAL], {}, "motion: there is no test of the moving axis"),
        ([BARE], {"force_constant": -1.0}, "force_constant: needs to be finite and above zero"),
        ([ELECTRICAL, BARE], {"pole_pitch": np.nan}, "pole_pitch: needs to be finite and above"),
    ],
)
def test_what_is_missing_or_wrong(records, given, says):
    with pytest.raises(ValueError, match=says):
        identify(records, **given)


def test_motion_without_the_end_effector_beside_motion_with_it_is_left_out_and_told():
    felt = BARE._replace(name="felt", tool=ROW)
    assert _left_out([ELECTRICAL, felt]) == _left_out([ELECTRICAL, BARE]) == []
    (line,) = _left_out([ELECTRICAL, felt, BARE])
    assert line.startswith("motion: the tests bare do not count, ")

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.flexible_axis.axis import thesis_axis
from jcontour.plants.flexible_axis.linear_motor import thesis_motor
from tuning.identification.flexible_axis.axis import _parameters, identify
from tuning.identification.flexible_axis.commissioning import Commissioning

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
def test_thesis_axis_within_a_few_per_cent(found):
    for name, tolerance in WITHIN.items():
        assert found.estimate[name] == pytest.approx(TRUTH[name], rel=tolerance), name
    for j in (1, 2, 3):
        assert found.estimate[f"amplitude_{j}"] == pytest.approx(
            TRUTH[f"amplitude_{j}"], rel=0.03
        ), j


@pytest.mark.slow
def test_intervals_hold_the_truth(found):
    """No error is beyond four deviations; the slow test counts how many are within two."""
    for name, truth in TRUTH.items():
        assert abs(found.estimate[name] - truth) < 4 * found.estimate.deviation(name), name


@pytest.mark.slow
def test_model_is_that_of_the_estimate(found):
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
def test_forces_scale_with_a_given_force_constant(found, records):
    """The same motion at twice the force constant: twice the masses and forces, the same link."""
    moved = [record for record in records if record.voltage is None]
    twice = identify(moved, force_constant=2 * found.estimate["force_constant"], pole_pitch=0.0875)
    for name in ("total_mass", "break_away", "viscous", "sine_1"):
        assert twice.estimate[name] == pytest.approx(2 * found.estimate[name], rel=1e-3), name
    assert twice.estimate["stiffness_per_mass"] == pytest.approx(
        found.estimate["stiffness_per_mass"], rel=1e-9
    )
    assert twice.notes[0].startswith("force_constant: taken as given") and twice.winding is None


@pytest.mark.slow
def test_without_an_end_effector(records):
    found = identify([record._replace(tool=None) for record in records])
    assert found.link is None and found.parameters is None
    assert any("not seen without tool_position" in note for note in found.notes)
    assert found.estimate["viscous"] == pytest.approx(250.9, rel=0.01)


@pytest.mark.slow
def test_motion_without_the_end_effector_beside_motion_with_it(found, records):
    """It is left out, and that is said."""
    more = identify([*records, records[1]._replace(name="bare", tool=None)])
    assert more.notes == (
        "motion: the tests bare do not count, "
        "for they have no tool_position and others have it; record it in all",
        *found.notes,
    )
    np.testing.assert_array_equal(more.estimate.values, found.estimate.values)


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


@pytest.mark.slow
def test_what_is_missing_or_wrong(records):
    electrical, *motion = records
    with pytest.raises(ValueError, match="needs an electrical test .* or its value, and not both"):
        identify(motion)
    with pytest.raises(ValueError, match="and not both"):
        identify(records, force_constant=79.0)
    with pytest.raises(ValueError, match="motion: there is no test of the moving axis"):
        identify([electrical])
    with pytest.raises(
        ValueError, match="force_constant: needs to be finite and above zero, received -1"
    ):
        identify(motion, force_constant=-1.0)
    with pytest.raises(
        ValueError, match="pole_pitch: needs to be finite and above zero, received nan"
    ):
        identify(records, pole_pitch=np.nan)


@pytest.mark.slow
def test_intervals_cover_as_often_as_they_promise():
    """The 95 % intervals hold the truth in 90 to 99 % of commissionings.

    Each has noise of its own, in the loop and in the records. All parameters are counted together;
    `evidence/identification.md` says how often each one is held over 200 seeds.
    """
    errors = []
    for seed in range(12):
        estimate = identify(
            Commissioning(thesis_axis(), thesis_motor(), seed=seed).thesis_tests()
        ).estimate
        errors.append(
            [(estimate[name] - truth) / estimate.deviation(name) for name, truth in TRUTH.items()]
        )
    assert 0.90 <= np.mean(np.abs(errors) < 1.96) <= 0.99

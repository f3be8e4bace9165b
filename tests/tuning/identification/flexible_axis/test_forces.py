import numpy as np
import pytest

from tuning.identification.flexible_axis.forces import fit_forces
from tuning.identification.flexible_axis.records import Record

K_T, DT = 60.0, 1e-3
MASS, TOOL, PUSH, PITCH = 25.0, 0.6, 1.2, 0.05
COULOMB, STRIBECK, STRIBECK_SPEED, VISCOUS = 30.0, 18.0, 0.25, 120.0
SINE, COSINE = (3.0, -0.8), (5.0, 1.1)


def swung(distance, pace, noise=0.0, seed=0, tool=True, cogging=True, falling=True):
    """To and fro as d (1 - cos w t), the end effector with a wobble.

    The current is what the balance asks for, in closed form.
    """
    random, time = np.random.default_rng(seed), DT * np.arange(round(2 * 2 * np.pi / pace / DT))

    def x(t):
        return distance * (1 - np.cos(pace * t))

    middle = time + DT / 2  # a current is held from row to row
    v, a = distance * pace * np.sin(pace * middle), distance * pace**2 * np.cos(pace * middle)
    wobble = 2e-3 * np.sin(60 * time)
    whip = -2e-3 * 3600 * np.sin(60 * middle)
    dry = COULOMB + STRIBECK / (1 + (v / STRIBECK_SPEED) ** 2) if falling else COULOMB + STRIBECK
    angle = 2 * np.pi / PITCH * x(middle)
    waves = sum(
        S * np.sin(j * angle) + C * np.cos(j * angle)
        for j, (S, C) in enumerate(zip(SINE, COSINE, strict=True), 1)
    )
    force = MASS * a + TOOL * whip * tool + np.sign(v) * dry + VISCOUS * v + PUSH + waves * cogging
    return Record(
        "swing",
        DT,
        x(time),
        force / K_T + noise * random.normal(size=time.size),
        x(time) + wobble if tool else None,
    )


SWINGS = [(0.1, 0.5), (0.1, 1.5), (0.15, 3.0), (0.1, 8.0)]  # [m], [rad/s]: up to 0.8 m/s


TRUTH = {
    "total_mass": MASS,
    "tool_mass": TOOL,
    "break_away": COULOMB + STRIBECK,
    "viscous": VISCOUS,
    "constant_force": PUSH,
    "drop": STRIBECK / STRIBECK_SPEED**2,
    "curvature": STRIBECK_SPEED**-2,
    "pole_pitch": PITCH,
    "sine_1": SINE[0],
    "sine_2": SINE[1],
    "cosine_1": COSINE[0],
    "cosine_2": COSINE[1],
}


def test_recovers_all_of_the_balance():
    """Harmonics beyond the two that there are may be taken for some, and come out as nothing."""
    fit = fit_forces([swung(*swing, noise=0.01) for swing in SWINGS], K_T)
    assert fit.cogging.highest >= 2 and set(TRUTH) <= set(fit.estimate.names)
    assert fit.fastest == pytest.approx(0.8, rel=0.02)
    for name in fit.estimate.names:
        assert fit.estimate[name] == pytest.approx(TRUTH.get(name, 0.0), rel=0.01, abs=0.02), name


@pytest.mark.slow
def test_intervals_under_noise():
    """The deviations are as large as promised, and no error is far beyond four of them."""
    errors = []
    for seed in range(4):
        records = []
        for k, swing in enumerate(SWINGS):
            records.append(swung(*swing, noise=0.1, seed=10 * seed + k))
        estimate = fit_forces(records, K_T).estimate
        assert "curvature" in estimate.names
        for name, value in TRUTH.items():
            errors.append((estimate[name] - value) / estimate.deviation(name))
    assert np.abs(errors).max() < 4.5 and 0.8 < np.std(errors) < 1.2


@pytest.mark.slow
def test_friction_that_falls_within_the_speeds_of_a_sweep():
    """The curve has to be found, although a parabola with half the drag fits it to 0.1 N."""
    slow = ((0.1, 0.5), (0.1, 1.0), (0.1, 2.0), (0.1, 3.5))
    fit = fit_forces([swung(*one, noise=0.1) for one in slow], K_T)
    low, high = fit.estimate.interval("viscous")
    assert low - (high - low) / 2 < VISCOUS < high + (high - low) / 2
    assert fit.estimate["curvature"] == pytest.approx(STRIBECK_SPEED**-2, rel=0.15)


@pytest.mark.slow
def test_friction_that_does_not_fall_has_no_curvature():
    fit = fit_forces([swung(*swing, noise=0.1, falling=False) for swing in SWINGS], K_T)
    assert "curvature" not in fit.estimate.names
    assert abs(fit.estimate["drop"]) < 4 * fit.estimate.deviation("drop")


@pytest.mark.slow
def test_known_pitch_no_end_effector_no_cogging():
    fit = fit_forces([swung(*swing, tool=False) for swing in SWINGS], K_T, PITCH)
    assert fit.cogging.pole_pitch == PITCH and not {"pole_pitch", "tool_mass"} & set(
        fit.estimate.names
    )
    assert fit.estimate["cosine_1"] == pytest.approx(COSINE[0], rel=0.01)
    smooth = fit_forces([swung(*swing, noise=0.1, cogging=False) for swing in SWINGS], K_T)
    assert smooth.estimate["viscous"] == pytest.approx(VISCOUS, rel=0.03)
    waves = [name for name in smooth.estimate.names if name.startswith(("sine", "cosine"))]
    assert all(abs(smooth.estimate[name]) < 0.1 for name in waves)  # of noise, if any


def test_needs_both_directions():
    record = swung(0.1, 1.5)
    half = slice(100, 1900)
    forwards = record._replace(
        motor=record.motor[half], current=record.current[half], tool=record.tool[half]
    )
    with pytest.raises(ValueError, match="needs to slide both ways, faster than 5 mm/s"):
        fit_forces([forwards], K_T)
    with pytest.raises(ValueError, match="needs to slide both ways"):
        fit_forces([record._replace(motor=0 * record.motor)], K_T)

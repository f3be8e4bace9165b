"""Speed axes against SciPy's discretisation and against the speeds that they settle at.

Continuous synchronisation against reference numbers and against the matrix exponential.

Bounds on beta against reference numbers, determinants and simulated loops.
"""

import warnings

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete

from jcontour.controllers.synchronisation.speed_axes import (
    ContinuousGains,
    Motion,
    SampledLoop,
    check_coupling,
    continuous_bound,
    continuous_response,
    coupling_matrix,
    exact_bound,
    loop_radius,
    positive_real_bound,
    positive_real_margin,
    sampled_loop,
    speed_axes,
)


@pytest.mark.parametrize("dt", [2e-3, 1e-2, 1.0])
def test_sampled_as_scipy_does(dt):
    axes = speed_axes([10.0, 3.0], [50.0, 20.0])
    a_d, b_d = axes.sampled(dt)
    for axis in range(2):
        matrices = ([[-axes.pole[axis]]], [[axes.gain[axis]]], [[1.0]], [[0.0]])
        A, B, *_ = cont2discrete(tuple(np.array(matrix) for matrix in matrices), dt)
        np.testing.assert_allclose([a_d[axis], b_d[axis]], [A.item(), B.item()], rtol=1e-12)


def test_feedforward_reproduces_any_speed():
    """One sample with the ideal estimates lands on the next speed."""
    axes, dt = speed_axes([10.0, 3.0], [50.0, 20.0]), 5e-3
    a_d, b_d = axes.sampled(dt)
    now, later = np.array([0.3, -0.2]), np.array([0.5, 0.1])
    signals = np.stack([now, later, np.ones(2)], axis=-1)
    control = np.sum(axes.feedforward(dt) * signals, axis=-1)
    np.testing.assert_allclose(a_d * now + b_d * control, later, atol=1e-15)
    slope = np.array([2.0, -1.0])
    signals = np.stack([now, slope, np.ones(2)], axis=-1)
    control = np.sum(axes.feedforward() * signals, axis=-1)
    np.testing.assert_allclose(-axes.pole * now + axes.gain * control, slope, atol=1e-14)


@pytest.mark.parametrize(("pole", "gain"), [(0.0, 1.0), (1.0, [1.0, -2.0]), (np.inf, 1.0)])
def test_bad_numbers(pole, gain):
    with pytest.raises(ValueError, match="needs to be finite and above zero"):
        speed_axes(pole, gain)


def gains_of(p, beta):
    return ContinuousGains(np.array(p["kc"]), p["gamma_c"], float(beta), p["v_c"])


@pytest.mark.parametrize("name", ["sync_nominal", "sync_low_kc"])
def test_a_step_of_load(synchronisation_numbers, stepped, name):
    reference = synchronisation_numbers[name]
    p = reference["parameters"]
    times = np.linspace(p["t_step"], p["t_end"], 2401)
    axes = speed_axes(p["a"], p["b"])
    for row in reference["continuous"]:
        run = continuous_response(axes, gains_of(p, row["beta"]), stepped(p), times)
        apart = run.error[:, 0] - run.error[:, 1]
        actual = [
            np.abs(apart).max(),
            np.trapezoid(np.abs(apart), times),
            *np.abs(run.error).max(axis=0),
            np.abs(apart[-1]),
        ]
        keys = ("peak_sync", "iae_sync", "peak_e1", "peak_e2", "final_sync")
        np.testing.assert_allclose(actual, [row[key] for key in keys], rtol=0, atol=1e-9)


def test_a_speed_that_moves(synchronisation_numbers, stepped):
    reference = synchronisation_numbers["sync_time_varying"]
    p = synchronisation_numbers["sync_nominal"]["parameters"]
    size, frequency = reference["wave"]
    turn = 2 * np.pi * frequency
    motion = Motion(
        lambda t: 1 + size * np.sin(turn * t),
        lambda t: size * turn * np.cos(turn * t),
        *stepped(p)[2:],
    )
    gains = gains_of(p, reference["beta"])
    run = continuous_response(speed_axes(p["a"], p["b"]), gains, motion, np.array(reference["t"]))
    np.testing.assert_allclose(run.error[:, 0], reference["e1"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.error[:, 1], reference["e2"], rtol=0, atol=1e-9)
    theta = run.estimate[-1].ravel()
    np.testing.assert_allclose(theta, reference["theta_end_continuous"], rtol=0, atol=1e-9)


def test_unequal_axes_against_the_matrix_exponential():
    """With a steady speed and load all is linear: e' = -(A + B k C) e - B s, s' = g |phi|^2 C e."""
    axes, k, g, beta, bias = speed_axes([10.0, 4.0], [50.0, 70.0]), (0.3, 0.5), 8.0, 1.5, 0.7
    load = np.array([0.2, -0.4])
    motion = Motion(lambda t: 1.3, lambda t: 0.0, lambda t: load)
    times = np.linspace(0.0, 0.8, 17)
    run = continuous_response(axes, ContinuousGains(np.array(k), g, beta, bias), motion, times)
    B, C = np.diag(axes.gain), coupling_matrix(beta)
    F = -np.diag(axes.pole) - B @ np.diag(k) @ C
    M = np.block([[F, -B], [g * (1.3**2 + bias**2) * C, np.zeros((2, 2))]])
    start = np.concatenate([np.zeros(2), load])
    wanted = np.array([expm(M * t) @ start for t in times])
    np.testing.assert_allclose(run.error, wanted[:, :2], rtol=0, atol=1e-10)


def test_bad_input():
    axes, gains = speed_axes([10.0, 10.0], 50.0), ContinuousGains(np.ones(2), 1.0, 0.0)
    still = Motion(lambda t: 1.0, lambda t: 0.0, lambda t: np.zeros(2))
    for times in ([], [-1.0, 0.0], [1.0, 1.0]):
        with pytest.raises(ValueError, match="times: need to increase"):
            continuous_response(axes, gains, still, np.array(times))
    with pytest.raises(ValueError, match="axes: synchronisation needs two"):
        continuous_response(speed_axes(10.0, 50.0), gains, still, np.array([0.0]))


NAMES = ("sync_nominal", "sync_low_kc")


def loops(numbers, name):
    p = numbers[name]["parameters"]
    for sampled in numbers[name]["discrete"]:
        axes = speed_axes(p["a"], p["b"])
        made = sampled_loop(
            axes, p["kc"], sampled["gamma_d"], p["omega_d"], sampled["T_s"], p["v_c"]
        )
        yield sampled, made


def matrices(loop, beta):
    """A_c0 and A_c1, written out."""
    C = np.array([[1 + beta, -beta], [-beta, 1 + beta]])
    inverse = np.diag(1 / loop.b_d)
    first = inverse - loop.adaptation * C
    return first, np.diag(loop.a_d / loop.b_d) - np.diag(loop.proportional) @ C


@pytest.mark.parametrize("name", NAMES)
def test_bounds_are_those_of_the_reference(synchronisation_numbers, name):
    for sampled, loop in loops(synchronisation_numbers, name):
        np.testing.assert_allclose(loop.adaptation, sampled["K"], rtol=1e-14)
        np.testing.assert_allclose(positive_real_bound(loop), sampled["beta_limit_spr"], rtol=1e-8)
        np.testing.assert_allclose(exact_bound(loop), sampled["beta_limit_lti"], rtol=1e-8)
        # 1 + 2 beta = (1 + a_d) / (b_d (K + k_c))
        strength = loop.b_d[0] * (loop.adaptation + loop.proportional[0])
        formula = ((1 + loop.a_d[0]) / strength - 1) / 2
        np.testing.assert_allclose(formula, sampled["beta_limit_formula"], rtol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_margins_are_those_of_the_reference(synchronisation_numbers, name):
    for sampled, loop in loops(synchronisation_numbers, name):
        for row in sampled["rows"]:
            beta = float(row["beta"])
            margin, radius = positive_real_margin(loop, beta), loop_radius(loop, beta)
            np.testing.assert_allclose(margin, row["spr_margin"], rtol=1e-8)
            np.testing.assert_allclose(radius, row["loop_spectral_radius"], rtol=1e-8)
            poles = np.linalg.eigvals(np.linalg.solve(*matrices(loop, beta)))
            assert bool(np.all(np.abs(poles) < 1)) is row["spr_poles_stable"]


def test_the_margin_is_the_least_over_all_frequencies():
    """The Hermitian part has the smallest eigenvalue 5.5 - 3 c - sqrt(13 - 12 c), c = cos w.

    It is smallest at c = 3/4, and 5/4 there.
    """
    loop = SampledLoop(np.array([0.3, 0.9]), np.full(2, 0.1), np.array([0.0, 2.0]), 1.5)
    assert positive_real_margin(loop, 2.0) == pytest.approx(1.25, rel=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_margin_of_unequal_axes_is_that_of_a_dense_grid(seed):
    random = np.random.default_rng(seed)
    loop = SampledLoop(
        random.uniform(0, 1, 2), random.uniform(0.1, 2, 2), random.uniform(0, 2, 2), 1
    )
    first, second = matrices(loop, 1.5)
    H = first - second * np.exp(-1j * np.linspace(0, np.pi, 20001))[:, None, None]
    dense = np.linalg.eigvalsh((H + np.conj(np.swapaxes(H, 1, 2))) / 2).min()
    margin = positive_real_margin(loop, 1.5)
    assert margin <= dense + 1e-12 and margin == pytest.approx(dense, abs=1e-6)


def test_no_bound_in_continuous_time_for_equal_gains():
    assert continuous_bound(speed_axes([10.0, 3.0], [50.0, 20.0]), 0.3) == np.inf


@pytest.mark.parametrize("gains", [(0.3, 0.5), (1.0, 0.01)])
def test_the_continuous_bound_is_where_the_determinant_vanishes(gains):
    axes, (one, two) = speed_axes([10.0, 3.0], [50.0, 20.0]), gains
    beta = continuous_bound(axes, gains)

    def smallest(beta):
        off = -beta * (one + two) / 2
        diagonal = axes.pole / axes.gain + (1 + beta) * np.array(gains)
        return np.linalg.eigvalsh([[diagonal[0], off], [off, diagonal[1]]])[0]

    assert smallest(0.999 * beta) > 0 > smallest(1.001 * beta)
    assert abs(smallest(beta)) < 1e-10 * beta


def iterated(loop, beta, steps=4000):
    """Size of the errors after many steps, written out axis by axis."""
    e, s = np.array([0.3, -0.2]), np.array([0.1, 0.4])
    for _ in range(steps):
        star = np.array([e[0] + beta * (e[0] - e[1]), e[1] - beta * (e[0] - e[1])])
        e = loop.a_d * e - loop.b_d * (loop.proportional * star + s)
        star = np.array([e[0] + beta * (e[0] - e[1]), e[1] - beta * (e[0] - e[1])])
        s = s + 2 * loop.adaptation * star
    return np.abs(e).max()


@pytest.mark.parametrize("seed", range(4))
def test_unequal_axes_diverge_just_above_the_exact_bound(seed):
    random = np.random.default_rng(seed)
    axes = speed_axes(random.uniform(2, 20, 2), random.uniform(20, 80, 2))
    loop = sampled_loop(axes, random.uniform(0.1, 0.5, 2), 0.1, 1.0, 5e-3)
    beta = exact_bound(loop)
    with np.errstate(all="ignore"):
        assert iterated(loop, 0.98 * beta) < 1e-3
        assert not iterated(loop, 1.02 * beta) < 1e3
    assert positive_real_bound(loop) <= beta * (1 + 1e-8)


def test_without_gains_there_is_no_bound():
    loop = sampled_loop(speed_axes([10.0, 10.0], 50.0), 0.0, 0.0, 1.0, 2e-3)
    assert exact_bound(loop) == np.inf


def test_a_loop_that_is_unstable_alone_has_the_bound_zero():
    loop = sampled_loop(speed_axes([10.0, 10.0], 50.0), 50.0, 0.1, 1.0, 2e-2)
    assert exact_bound(loop) == 0 and positive_real_bound(loop) == 0


def test_a_coupling_above_its_bound_is_warned_of():
    axes = speed_axes([10.0, 10.0], 50.0)
    loop = sampled_loop(axes, 0.2, 0.18, 1.0, 1e-2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_coupling(loop, 0.9)
    with pytest.warns(UserWarning, match=r"beta is 2, .* below 0.9286 only.* from 3.759 on"):
        check_coupling(loop, 2.0)
    with pytest.warns(UserWarning, match=r"beta is 4, at 3.759 and above the axes diverge"):
        check_coupling(loop, 4.0)


def test_bad_input_of_limits():
    with pytest.raises(ValueError, match="axes: synchronisation needs two"):
        sampled_loop(speed_axes(10.0, 50.0), 0.3, 0.1, 1.0, 1e-3)
    with pytest.raises(ValueError, match="adaptation: needs to be at least zero"):
        sampled_loop(speed_axes([10.0, 10.0], 50.0), 0.3, -0.1, 1.0, 1e-3)

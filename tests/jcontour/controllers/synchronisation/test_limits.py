"""Bounds on beta against reference numbers, determinants and simulated loops."""

import warnings

import numpy as np
import pytest

from jcontour.controllers.synchronisation.speed_axes import (
    SampledLoop,
    check_coupling,
    continuous_bound,
    exact_bound,
    has_stable_poles,
    loop_radius,
    positive_real_bound,
    positive_real_margin,
    sampled_loop,
    speed_axes,
)

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
            assert has_stable_poles(loop, beta) is row["spr_poles_stable"]


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


def test_bad_input():
    with pytest.raises(ValueError, match="axes: synchronisation needs two"):
        sampled_loop(speed_axes(10.0, 50.0), 0.3, 0.1, 1.0, 1e-3)
    with pytest.raises(ValueError, match="adaptation: needs to be at least zero"):
        sampled_loop(speed_axes([10.0, 10.0], 50.0), 0.3, -0.1, 1.0, 1e-3)

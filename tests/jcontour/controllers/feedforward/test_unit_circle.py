"""Zeros on the unit circle against Table 2 and the explicit loop with integral action."""

import numpy as np
import pytest
from numpy.polynomial import polynomial

from jcontour.controllers.feedforward.model_matching import corollary_1, l1_norm, perturbed_error


def test_corollary_1_is_table_2(alter_tsao):
    for row in alter_tsao["table2"]:
        for which in ("b_printed", "b_fitted"):
            found = corollary_1(row[which]["M_b"], alter_tsao[which])
            assert found.attainable == pytest.approx(row[which]["J1_opt"], rel=1e-8)
            assert found.limit == pytest.approx(row[which]["lim_J_eps"], rel=1e-8)


@pytest.fixture(scope="module")
def model(alter_tsao):
    """M = lambda^8 - (1 / lambda) P C / (1 + P C) of controller B."""
    loop = alter_tsao["explicit_loop"]
    feedback = loop["B_lead_integral"]
    through = np.convolve(loop["num_lambda"], feedback["num_lambda"])
    closed = polynomial.polyadd(np.convolve(loop["den_lambda"], feedback["den_lambda"]), through)
    delayed = np.eye(1, 9, 8)[0]
    return polynomial.polysub(np.convolve(delayed, closed), through[1:]), closed


def test_the_perturbed_loop(alter_tsao, model):
    wanted = alter_tsao["explicit_loop"]["perturbation_0_9_0"]
    assert l1_norm(*model) == pytest.approx(wanted["norm_M_this_controller"], abs=1e-9)
    circle = np.exp(1j * np.linspace(0, np.pi, 20001))
    for row in wanted["sweep"]:
        top, below = perturbed_error(model, np.array([alter_tsao["b_printed"] ** 8]), row["eps"])
        assert l1_norm(top, below) == pytest.approx(row["J_eps"], abs=1e-9)
        modulus = np.abs(polynomial.polyval(circle, top) / polynomial.polyval(circle, below))
        assert modulus.max() == pytest.approx(row["hinf_grid"], abs=1e-9)


def test_l1_norms_in_closed_form():
    assert l1_norm(np.array([1.0]), np.array([1.0, -0.9])) == pytest.approx(10.0)
    assert l1_norm(np.array([1.0, -2.0]), np.array([1.0])) == pytest.approx(3.0)
    with pytest.raises(ValueError, match="not stable"):
        l1_norm(np.array([1.0]), np.array([1.0, -1.0]))


def test_bad_input(model):
    with pytest.raises(ValueError, match="between -1 and 0"):
        corollary_1(1.0, 0.3)
    with pytest.raises(ValueError, match="eps"):
        perturbed_error(model, np.array([1.0]), 0.0)

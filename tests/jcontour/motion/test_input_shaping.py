import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jcontour.motion.input_shaping import Shaper, ei, zv, zvd

W, ZETA = 87.0, 0.1
OFF = np.linspace(0.5, 1.5, 41)  # of the modelled frequency
CLOSED = {
    "zv": (zv, lambda x: np.abs(np.cos(np.pi * x / 2))),
    "zvd": (zvd, lambda x: np.cos(np.pi * x / 2) ** 2),
    "ei": (ei, lambda x: np.abs(0.95 + 1.05 * np.cos(np.pi * x)) / 2),
}


def residual(shaper, frequency, damping=0.0):
    """V of the module, for modes w and zeta of one shape."""
    w, zeta = np.broadcast_arrays(np.asarray(frequency, float), damping)
    since = np.asarray(shaper.times) - float(shaper.times[-1])
    left = np.exp(np.multiply.outer(w * (zeta + 1j * np.sqrt(1 - zeta**2)), since))
    return np.abs(left @ np.asarray(shaper.amplitudes))


@pytest.mark.parametrize(("make", "closed"), CLOSED.values(), ids=CLOSED)
def test_sensitivity_without_damping(make, closed):
    np.testing.assert_allclose(residual(make(W), W * OFF), closed(OFF), rtol=0, atol=1e-14)


def test_ei_is_zero_twice_and_below_five_per_cent_for_forty():
    zeros = np.arccos([-0.95 / 1.05]) / np.pi
    np.testing.assert_allclose(
        residual(ei(W), W * np.array([zeros[0], 2 - zeros[0]])), 0, atol=1e-14
    )
    edge = np.arccos((3 * 0.05 - 1) / 1.05) / np.pi
    np.testing.assert_allclose(
        residual(ei(W), W * np.array([edge, 1.0, 2 - edge])), 0.05, rtol=1e-12
    )
    assert 2 * (1 - edge) == pytest.approx(0.3993, abs=5e-4)  # the literature's 0.399
    assert residual(ei(W), W * np.linspace(edge, 2 - edge, 200)).max() < 0.05 + 1e-12


@pytest.mark.parametrize("zeta", [0.0, 0.0316, 0.2])
def test_what_is_left_of_the_modelled_mode(zeta):
    assert residual(zv(W, zeta), W, zeta) < 1e-14
    assert residual(zvd(W, zeta), W, zeta) < 1e-14
    assert residual(ei(W, zeta), W, zeta) == pytest.approx(0.05, rel=1e-12)
    assert residual(ei(W, zeta, 0.1), W, zeta) == pytest.approx(0.1, rel=1e-12)


@pytest.mark.parametrize("zeta", [0.0, 0.1])
def test_zvd_is_flat_and_zv_is_not(zeta):
    """By central differences of the complex sum, whose modulus is V."""
    h = 1e-4
    slopes = [
        (residual(make(W, zeta), W * (1 + h), zeta) + residual(make(W, zeta), W * (1 - h), zeta))
        / (2 * h)
        for make in (zv, zvd)
    ]
    assert slopes[0] > 0.5 and slopes[1] < 1e-3


@pytest.mark.parametrize("zeta", [0.05, 0.1, 0.2])
def test_damped_ei_has_its_zeros_where_the_decay_is_the_same(zeta):
    decay, damped = zeta * W, W * np.sqrt(1 - zeta**2)
    K = np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
    G = 0.05 * (1 + K) ** 2 / (4 * K**2 - 0.05 * (1 - K) ** 2)
    for sign in (1, -1):
        other = damped * (1 + sign * (1 - np.arccos(-(1 - G) / (1 + G)) / np.pi))
        w = np.hypot(decay, other)
        assert residual(ei(W, zeta), w, decay / w) < 1e-14


def test_residual_vibration_is_that_of_an_oscillator():
    """Unit impulses through x'' + 2 zeta w x' + w^2 x.

    Its free motion is added up by an integrator.
    """
    shaper, w, zeta = zvd(70.0, 0.05), 90.0, 0.12
    state, time = np.zeros(2), 0.0
    for t, a in zip(np.asarray(shaper.times), np.asarray(shaper.amplitudes), strict=True):
        if t > time:
            free = solve_ivp(
                lambda _, x: [x[1], -2 * zeta * w * x[1] - w**2 * x[0]],
                (time, t),
                state,
                rtol=1e-11,
                atol=1e-14,
            )
            state, time = free.y[:, -1], t
        state = state + [0, a]
    damped = w * np.sqrt(1 - zeta**2)
    amplitude = np.hypot(
        damped * state[0], state[1] + zeta * w * state[0]
    )  # one after a unit impulse
    assert residual(shaper, w, zeta) == pytest.approx(amplitude, rel=1e-8)


def test_gradient_reaches_the_mode():
    def left(mode):
        shaper = ei(mode[0], mode[1])
        return jnp.sum(jnp.cos(95.0 * shaper.times) * shaper.amplitudes)

    at, h = np.array([W, ZETA]), 1e-6
    slope = jax.grad(left)(jnp.asarray(at))
    for i in range(2):
        step = h * at[i] * np.eye(2)[i]
        np.testing.assert_allclose(
            slope[i], (left(at + step) - left(at - step)) / (2 * h * at[i]), rtol=1e-6
        )


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: zv(0.0), "frequency"),
        (lambda: zv(W, 1.0), "damping"),
        (lambda: ei(W, -0.1), "damping"),
        (lambda: ei(W, 0.0, 1.0), "vibration"),
        (lambda: ei(W, 0.7), "vibration"),
        (lambda: Shaper([0.0, 1.0], [1.0]), "amplitudes"),
        (lambda: Shaper([0.0, 1.0], [1.0, 1.0]), "amplitudes"),
        (lambda: Shaper([0.5, 1.0], [0.5, 0.5]), "times"),
    ],
)
def test_bad_input_is_named(make, name):
    with pytest.raises(ValueError, match=f"^{name}: "):
        make()

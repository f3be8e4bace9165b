import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from jcontour.geometry.contours import circle, line
from jcontour.motion.input_shaping import (
    Shaper,
    ei,
    in_series,
    residual_vibration,
    shaped_law,
    zv,
    zvd,
)
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import in_time

W, ZETA = 87.0, 0.1
LAW = PointToPoint(0.02, 0.1, 4.0)
OFF = np.linspace(0.5, 1.5, 41)  # of the modelled frequency
CLOSED = {
    "zv": (zv, lambda x: np.abs(np.cos(np.pi * x / 2))),
    "zvd": (zvd, lambda x: np.cos(np.pi * x / 2) ** 2),
    "ei": (ei, lambda x: np.abs(0.95 + 1.05 * np.cos(np.pi * x)) / 2),
}


def residual(shaper, frequency, damping=0.0):
    """At most 200 frequencies, always 200 at a time: one program for each number of impulses."""
    w, zeta = np.broadcast_arrays(np.asarray(frequency, float), damping)
    found = jax.jit(residual_vibration)(shaper, np.resize(w, 200), np.resize(zeta, 200))
    return np.asarray(found)[: w.size].reshape(w.shape)


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
    shaper, w, zeta = in_series(zvd(70.0, 0.05), zv(200.0)), 90.0, 0.12
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


def test_several_modes_at_once():
    shaper = in_series(zv(W, ZETA), zvd(150.0), ei(400.0))
    assert shaper.times.size == 2 * 3 * 3 and np.sum(shaper.amplitudes) == pytest.approx(1)
    assert np.all(np.diff(shaper.times) >= 0)
    apart = (zv(W, ZETA), zvd(150.0), ei(400.0))
    assert float(shaper.duration) == pytest.approx(sum(float(one.duration) for one in apart))
    np.testing.assert_allclose(
        residual(shaper, np.array([W, 150.0]), np.array([ZETA, 0.0])), 0, atol=1e-14
    )
    assert residual(shaper, 400.0) <= 0.05


def left_to_vibrate(reference, step, zeta=ZETA):
    """Amplitude at the end of w^2 / (s^2 + 2 zeta w s + w^2) along a reference.

    The reference is linear in between; the amplitude is as it would be at time zero.
    """
    time = step * np.arange(len(reference))
    x = lsim(
        ([[0, 1], [-(W**2), -2 * zeta * W]], [[0], [W**2]], np.eye(2), np.zeros((2, 1))),
        reference,
        time,
    )[1][-1]
    away = x[0] - reference[-1]
    return np.hypot(W * np.sqrt(1 - zeta**2) * away, x[1] + zeta * W * away) * np.exp(
        zeta * W * time[-1]
    )


def test_a_shaped_law_leaves_no_vibration():
    step = 1e-5
    time = step * np.arange(34_000)
    plain = left_to_vibrate(LAW(time), step)
    assert left_to_vibrate(shaped_law(LAW, zv(W, ZETA))(time), step) < 1e-5 * plain
    assert left_to_vibrate(shaped_law(LAW, zvd(W, ZETA))(time), step) < 1e-5 * plain


def test_samples_have_the_impulses_at_their_exact_times():
    """Against impulses that are rounded to the sample."""
    dt, shaper = 1e-3, zv(W, ZETA)
    rounded = Shaper(dt * np.round(np.divide(shaper.times, dt)), shaper.amplitudes)
    left = []
    for impulses in (shaper, rounded):
        reference = in_time(line([0.0], [0.02]), shaped_law(LAW, impulses), 0.34, dt)
        left.append(left_to_vibrate(np.asarray(reference.position)[:, 0], dt))
    assert left[0] < 0.1 * left[1]


def test_a_shaped_law_is_the_sum_of_delayed_copies_and_stays_on_its_contour():
    shaper, time = zvd(W, ZETA), np.linspace(0, 0.4, 77)
    copies = [
        a * LAW(np.maximum(time - t, 0))
        for t, a in zip(np.asarray(shaper.times), np.asarray(shaper.amplitudes), strict=True)
    ]
    np.testing.assert_allclose(shaped_law(LAW, shaper)(time), np.sum(copies, axis=0), rtol=1e-13)
    reference = in_time(circle(5e-3), shaped_law(LAW, shaper), 0.4, 1e-3)
    np.testing.assert_allclose(np.linalg.norm(reference.position, axis=1), 5e-3, rtol=1e-12)


def test_gradient_reaches_the_mode():
    def left(mode):
        return residual_vibration(ei(mode[0], mode[1]), 95.0, 0.05)

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

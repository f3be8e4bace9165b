import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, lfilter, ss2tf

from jcontour.linear.continuous_axes import sampled_axis, speed_axis, with_resonance
from tuning.identification.linear.axis_model import (
    DAMPING,
    STIFFNESS,
    AxisModel,
    other_amplitudes,
    two_masses,
)

DT = 1e-3
MODEL = AxisModel(np.array([-1.5, 0.6]), np.array([2e-4, 1e-4, 3e-5]), 1, 3, DT)


def test_the_response_is_that_of_the_sampled_axis():
    """K / (s (T s + 1)) by hand: the zero-order hold of Astrom & Wittenmark, table 2.1."""
    K, T, delay = 0.03, 0.012, 2
    p, ratio = np.exp(-DT / T), DT / T
    b1, b2 = K * T * (ratio - 1 + p), K * T * (1 - p - ratio * p)
    model = AxisModel(np.array([-p]), np.array([b1, b2]), 1, delay, DT)
    A, B, C, _ = sampled_axis(speed_axis(K, T), DT)
    w = 2 * np.pi * np.array([0.1, 3.0, 40.0, 300.0])
    z = np.exp(1j * w * DT)
    expected = [(C @ np.linalg.solve(v * np.eye(2) - A, B)).item() * v**-delay for v in z]
    assert np.allclose(model.response(w), expected, rtol=1e-9)
    assert model.order == 2 and np.allclose(model.poles, [p])


@pytest.mark.parametrize("line", [0, 2, 3])
def test_the_realisation_answers_as_the_transfer_function(line):
    u = np.random.default_rng(0).standard_normal(60)
    A, B, C = MODEL.realisation(line)
    y = dlsim((A, B, C, np.zeros((1, 1)), DT), u[:, None])[1]
    late = np.concatenate([np.zeros(line), u])[:60]
    whole = AxisModel(MODEL.denominator, MODEL.numerator, 1, 0, DT)
    assert np.allclose(y[:, 0], lfilter(whole.above, whole.below, late), rtol=1e-10)


def test_the_realisation_of_an_axis_that_is_sampled_fast():
    """Its integrator stays one: of powers of z rounding would move it by 1e-8 here."""
    poles = np.array([0.9996, 0.9994, *(0.9995 * np.exp(np.array([1j, -1j]) * 0.02))])
    zeros = 0.999 * np.exp(np.array([1j, -1j]) * 0.015)
    below, above = np.real(np.poly(poles))[1:], 1e-9 * np.real(np.poly(zeros))
    A, B, C = AxisModel(below, above, 1, 2, DT).realisation(2)
    assert np.abs(np.linalg.eigvals(A) - 1).min() < 1e-14
    z = np.exp(2j * np.pi * np.array([0.1, 1.0, 20.0]) * DT)
    answer = [(C @ np.linalg.solve(one * np.eye(len(A)) - A, B)).item() for one in z]
    factors = np.prod(z[:, None] - zeros, axis=1) / np.prod(z[:, None] - poles, axis=1) / (z - 1)
    np.testing.assert_allclose(answer, 1e-9 * factors, rtol=1e-5)


def test_slopes_of_the_logarithm():
    w, step = np.array([20.0, 400.0]), 1e-7
    value, slopes = MODEL.log_terms(w)
    for k in range(5):
        a, b = MODEL.denominator.copy(), MODEL.numerator.copy()
        size = step if k < 2 else step * 1e-4
        (a if k < 2 else b)[k % 2 if k < 2 else k - 2] += size
        moved = AxisModel(a, b, 1, 3, DT).log_terms(w)[0]
        assert np.allclose((moved - value) / size, slopes[:, k], rtol=1e-4)


def test_a_resonance_is_found_among_the_poles():
    axis = with_resonance(speed_axis(1.0, 0.01), 2 * np.pi * 60, 0.1)
    A, *_ = sampled_axis(axis, DT)
    below = np.poly(np.linalg.eigvals(A)).real
    rest, _ = np.polydiv(below, [1, -1])
    model = AxisModel(rest[1:], np.ones(1), 1, 0, DT)
    assert np.abs(np.log(model.poles)).max() / DT / 2 / np.pi == pytest.approx(60, rel=1e-6)


FINE, FORCE = 5e-4, 0.4


def model(A, B, C):
    """The axis, sampled, its integrator apart."""
    a, b, c, *_ = cont2discrete((A, B, C, np.zeros((1, 1))), FINE)
    poles = np.linalg.eigvals(a)
    poles = np.delete(poles, np.argmin(np.abs(poles - 1)))
    markov, x = [], b
    for _ in range(len(a)):
        markov.append((c @ x).item())
        x = a @ x
    below = np.real(np.convolve(np.poly(poles), [1.0, -1.0]))
    return AxisModel(np.real(np.poly(poles))[1:], np.convolve(markov, below)[: len(a)], 1, 2, FINE)


@pytest.mark.parametrize(("motor", "load", "stiffness"), [(5e-3, 4.9e-3, 567.0), (60.0, 20.0, 2e6)])
def test_masses_and_spring_of_a_known_axis(motor, load, stiffness):
    """Damped as the bench is: c = 0.01 N s/m and viscous friction of 4 N s/m per 100 kg."""
    viscous, c = 0.04 * motor, 1e-4 * np.sqrt(stiffness * load)
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-stiffness / motor, -(c + viscous) / motor, stiffness / motor, c / motor],
            [0.0, 0.0, 0.0, 1.0],
            [stiffness / load, c / load, -stiffness / load, -c / load],
        ]
    )
    B = np.array([[0.0], [FORCE / motor], [0.0], [0.0]])
    found = two_masses(model(A, B, np.eye(1, 4)), FORCE)
    assert found == pytest.approx((motor, load, stiffness), rel=0.01)
    at_the_load = np.array([[0.0, 0.0, 1.0, 0.0]])
    assert two_masses(model(A, B, at_the_load), FORCE) is None


MOTOR, LOAD, HERTZ = 60.0, 30.0, 55.0  # [kg], [kg], [Hz] of the resonance


def coupled(share, drive, at_the_load=False, damper=0.0):
    """Motor and load on a share of the spring; a drive is its gains of position and speed."""
    reduced, w = MOTOR * LOAD / (MOTOR + LOAD), 2 * np.pi * HERTZ
    k, c, viscous = share * reduced * w**2, 2 * 0.03 * np.sqrt(share) * reduced * w, 150.0
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-k / MOTOR, -(c + viscous) / MOTOR, k / MOTOR, c / MOTOR],
            [0.0, 0.0, 0.0, 1.0],
            [k / LOAD, c / LOAD, -k / LOAD, -(c + damper) / LOAD],
        ]
    )
    B = np.array([[0.0], [35.0 / MOTOR], [0.0], [0.0]])
    if drive is not None:
        place, speed = drive
        A, B = A - B @ np.array([[place * speed, speed, 0.0, 0.0]]), place * speed * B
    C = np.eye(1, 4, 2 if at_the_load else 0)
    return cont2discrete((A, B, C, np.zeros((1, 1))), DT)[:3]


def transfer(plant, drive):
    """As an `AxisModel`, a delay of two samples behind it."""
    A, B, C = plant
    above, below = ss2tf(A, B, C, np.zeros((1, 1)))
    free = drive is None
    below = np.real(np.polydiv(below, [1.0, -1.0])[0]) if free else below
    return AxisModel(below[1:], above[0, 1:], int(free), 2, DT)


@pytest.mark.parametrize("drive", [None, (43.0, 440.0)])
def test_a_coupling_in_its_gap_is_softer_and_a_load_with_friction_damped(drive):
    w, off = other_amplitudes(transfer(coupled(1.0, drive), drive), np.pi / DT)
    ends = [0, *np.flatnonzero(np.diff(w) < 0) + 1, len(w)]
    k = (2 * np.pi * HERTZ) ** 2 * MOTOR * LOAD / (MOTOR + LOAD)
    others = [(share, 0.0) for share in STIFFNESS]
    others += [(1.0, one * np.sqrt(k * LOAD)) for one in DAMPING]
    assert len(ends) == len(others) + 1 and np.abs(off).max() > 5

    def response(share, damper, w):
        A, B, C = coupled(share, drive, damper=damper)
        z = np.exp(1j * w * DT)
        return np.array([(C @ np.linalg.solve(one * np.eye(4) - A, B)).item() for one in z])

    for other, first, last in zip(others, ends[:-1], ends[1:], strict=True):
        part = w[first:last]
        ratio = response(*other, part) / response(1.0, 0.0, part)
        near = 0.01 if other[1] == 0 else 0.05
        assert np.abs(part / np.sqrt(k / LOAD) - 1).min() < 0.01  # where a controller may be sharp
        np.testing.assert_allclose(1 + off[first:last], ratio, rtol=near, atol=near)


@pytest.mark.parametrize("drive", [None, (43.0, 440.0)])
def test_an_encoder_at_the_load_sees_no_gap_in_front_of_it(drive):
    for at_the_load, highest in ((True, np.pi / DT), (False, 2 * np.pi * 0.9 * HERTZ)):
        axis = transfer(coupled(1.0, drive, at_the_load), drive)
        assert all(part.size == 0 for part in other_amplitudes(axis, highest))

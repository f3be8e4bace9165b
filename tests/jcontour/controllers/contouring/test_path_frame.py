"""What all contouring schemes keep to; what each does is in its own test file."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.contouring.schemes import (
    CommandShaped,
    ConstantCoupling,
    CrossCoupled,
    CrossGains,
    PathFrame,
    Precompensated,
    TaskFrame,
    VariableCoupling,
)
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.geometry.contours import circle
from jcontour.motion.references import along, from_samples
from jcontour.plants.flexible_axis.axis import AxisParameters, SmoothFlexibleAxis
from jcontour.plants.friction import Friction
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import prepared, simulate

SCHEMES = {
    "cross-coupled": lambda cascade, k: CrossCoupled(
        cascade, CrossGains(5.0 * k, 20.0 * k, 0.05 * k), ConstantCoupling()
    ),
    "cross-coupled-variable": lambda cascade, k: CrossCoupled(
        cascade, CrossGains(5.0 * k, 20.0 * k, 0.05 * k), VariableCoupling()
    ),
    "task-frame": lambda cascade, k: TaskFrame(
        eqx.tree_at(lambda c: c.gains.position, cascade, jnp.array([30.0, 30.0 + 9.0 * k]))
    ),
    "precompensated": lambda cascade, k: Precompensated(cascade, 4.0 * k),
    "command-shaped": lambda cascade, k: CommandShaped(cascade, 0.7 * k),
}


def flexible_pair():
    """Two different flexible axes, smooth, with cogging and friction."""
    friction = Friction([36.0, 20.0], [22.0, 10.0], [2.8, 1.0], [250.0, 150.0])
    cogging = [[4.0, 1.0], [2.0, 3.0]]
    parameters = AxisParameters(
        [40.0, 20.0],
        [0.4, 0.6],
        [2900.0, 5000.0],
        [2.0, 3.0],
        [80.0, 50.0],
        friction,
        cogging,
        cogging,
        0.0875,
    )
    return SmoothFlexibleAxis(parameters, 1e-3, substeps=4)


def flexible_cascade():
    return Cascade(
        CascadeGains(np.array([30.0, 30.0]), np.array([55.0, 40.0]), 0.04, 0.3, 0.2, 1.0, 0.1),
        Sensors((0, 1), (2, 3)),
        1e-3,
    )


@pytest.mark.parametrize("clockwise", [False, True])
def test_contour_error_of_a_circle(clockwise):
    """On the circle through r, r - y = e has c'e = (|y|^2 - R^2) / 2R.

    It is positive to the left of the path on a clockwise turn.
    """
    random = np.random.default_rng(0)
    for angle in random.uniform(0, 2 * np.pi, 5):
        sign, radius = -1.0 if clockwise else 1.0, 0.03
        radial = np.array([np.cos(angle), np.sin(angle)])
        tangent = placed(sign * np.array([-radial[1], radial[0]]))
        frame = PathFrame(tangent, placed(np.array(sign / radius)))
        tool = radius * radial + random.normal(0, 1e-3, 2)
        expected = sign * (tool @ tool - radius**2) / (2 * radius)
        assert float(frame.contour_error(placed(radius * radial - tool))) == pytest.approx(
            expected, rel=1e-12
        )


def test_frames_along_a_reference(table):
    scheme = TaskFrame(table.cascade())
    left = prepared(scheme, table.on_circle(steps=50)).frame
    right = prepared(scheme, table.on_circle(clockwise=True, steps=50)).frame
    straight = prepared(scheme, table.on_line(0.7, steps=50)).frame
    np.testing.assert_allclose(left.curvature, 1 / table.radius, rtol=1e-12)
    np.testing.assert_allclose(right.curvature, -1 / table.radius, rtol=1e-12)
    np.testing.assert_allclose(straight.curvature, 0.0, atol=1e-12)
    np.testing.assert_allclose(
        straight.normal, np.tile([-np.sin(0.7), np.cos(0.7)], (50, 1)), rtol=1e-12
    )


@pytest.mark.parametrize("name", SCHEMES)
def test_zero_gain_is_the_plain_cascade(name):
    cascade, plant = flexible_cascade(), flexible_pair()
    reference = along(circle(0.02), 5e-5 * np.arange(150), 1e-3, 1, at_rest=False)
    plain = simulate(plant, cascade, reference)
    run = simulate(plant, SCHEMES[name](cascade, 0.0), reference)
    np.testing.assert_allclose(
        run.control, plain.control, rtol=0, atol=1e-11 * np.abs(plain.control).max()
    )
    moved = simulate(plant, SCHEMES[name](cascade, 1.0), reference)
    assert np.abs(moved.control - plain.control).max() > 1e-3 * np.abs(plain.control).max()


@pytest.mark.parametrize("scheme", [Precompensated, CommandShaped])
@pytest.mark.parametrize("gain", [-1.0, np.nan, np.inf])
def test_bad_gains_are_refused(scheme, gain):
    with pytest.raises(ValueError, match="gain: needs to be finite"):
        scheme(flexible_cascade(), gain)


@pytest.mark.parametrize("name", SCHEMES)
def test_other_than_two_axes_is_one_line(name, table):
    samples = np.zeros((20, 3))
    samples[:, 0] = np.arange(20)
    reference = from_samples(samples, np.tile([1.0, 0.0, 0.0], (20, 1)), table.dt, 1)
    with pytest.raises(ValueError, match="two axes, received 3"):
        SCHEMES[name](table.cascade(), 1.0).prepare(reference)

"""Certificates of whole loops: reached, never exceeded, and refused where there is none."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.bounds.affine import NotAffine
from jcontour.bounds.certificates import certificate, check_limits
from jcontour.bounds.disturbed_loop import Box
from jcontour.bounds.peak_bounds import coefficients
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedforward.inverse_feedforward import FrictionFeedforward
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import (
    OffsetFreeObserver,
    offset_free_gain,
)
from jcontour.geometry.contours import line, polygon
from jcontour.motion.references import along
from jcontour.plants.actuation import Disturbed
from jcontour.plants.encoders import Encoders, Quantised
from jcontour.plants.linear_machines import servo_axes
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import contour_error

SQUARE = polygon([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3], [0.0, 1e-3]])


def around_the_square(dt):
    return along(SQUARE, 2e-5 * np.arange(200), dt, 5, at_rest=False)


def offset_free(model, limit=np.inf):
    inner = ContouringLQ(model, LQWeights(1e10, 1e10, 1.0), preview=5)
    gain = offset_free_gain(model, model.C, 0.1, 0.01, 1e-7)
    return OffsetFreeObserver(inner, model, gain=gain, measured=model.C, limit=jnp.asarray(limit))


def errors(plant, controller, reference):
    run = simulate(plant, controller, reference)
    return np.linalg.norm(np.asarray(contour_error(run.output, reference)), axis=1), run


BOX = Box.of(0.05, 4e-7, inputs=2, measured=2)


@pytest.mark.slow
def test_no_lap_around_a_square_exceeds_its_certificate(two_axes):
    plant, controller = Encoders(two_axes), offset_free(two_axes, limit=100.0)
    reference = around_the_square(two_axes.dt)
    actual = certificate(plant, controller, reference, BOX)
    reached = [errors(one.on(plant), controller, reference)[0] for one in actual.attacks()]
    assert np.all(np.array(reached) <= actual.bound)
    assert max(error[actual.worst] for error in reached) > 0.9 * actual.largest
    random = np.random.default_rng(2)
    for _ in range(5):
        w = np.sign(random.standard_normal((reference.steps, 4))) * BOX.size
        w = np.repeat(w[::10], 10, axis=0)
        pushed = Disturbed(plant, force=jnp.asarray(w[:, :2]), noise=jnp.asarray(w[:, 2:]))
        error, run = errors(pushed, controller, reference)
        assert np.all(error <= actual.bound) and np.all(np.abs(run.control) <= actual.control)


@pytest.mark.slow
def test_whole_counts_are_inside_a_box_of_half_a_count(two_axes):
    plant, controller = Encoders(two_axes), offset_free(two_axes)
    reference = around_the_square(two_axes.dt)
    actual = certificate(plant, controller, reference, BOX)
    reached = []
    for attack in actual.attacks():
        counting = Disturbed(Quantised(plant, 8e-7), force=jnp.asarray(attack.force))
        reached.append(errors(counting, controller, reference)[0])
    assert np.all(np.array(reached) <= actual.bound)
    assert max(error[actual.worst] for error in reached) > 0.4 * actual.largest


@pytest.mark.slow
def test_the_true_distance_of_the_reference_circle(reference_circle, circle_bound):
    row = reference_circle.rows[0]
    controller, box = reference_circle.of(row)
    plant, reference = reference_circle.plant, reference_circle.reference
    actual = certificate(plant, controller, reference, box)
    numbers = reference_circle.numbers["true_distance_m"]
    worst = 504 + int(np.argmax(actual.bound[504:]))
    # rigorous: it never falls below the exact value, and is above the closed form by its chords
    assert numbers["exact"] * (1 - 1e-8) <= actual.bound[worst] <= numbers["exact"] * (1 + 2e-6)
    C, centre = np.asarray(actual.loop.C), np.asarray(reference_circle.path.polynomial[0, 0])
    effects = [(coefficients(actual.loop, C[worst, i], worst) * box.size).ravel() for i in range(2)]
    output = np.asarray(actual.loop.output[worst])
    exact = max(circle_bound(centre, 1e-3, output, np.stack(effects)))
    assert exact == pytest.approx(numbers["exact"], rel=1e-8)
    reached = max(
        errors(attack.on(plant), controller, reference)[0][worst]
        for attack in actual.attacks(worst)
    )
    assert 0.999 * actual.bound[worst] < reached <= actual.bound[worst]


@pytest.mark.slow
def test_one_axis_is_bounded_in_its_travel():
    drive = servo_axes(gain=[50.0], pole=[10.0], dt=5e-3)
    loop = Cascade(CascadeGains(8.0, 0.6, 0.1), Sensors((0,), (1,)), drive.dt)
    reference = along(line([0.0], [10e-3]), 5e-5 * np.arange(60), drive.dt, 1, at_rest=False)
    box = Box.of(0.01, 1e-6, inputs=1, measured=2)
    actual = certificate(drive, loop, reference, box)
    runs = [simulate(one.on(drive), loop, reference).output for one in actual.attacks()]
    error = np.abs(np.array(runs) - np.asarray(reference.position[: reference.steps]))[..., 0]
    assert error[:, actual.worst].max() == pytest.approx(actual.largest, rel=1e-9)
    assert np.all(error <= actual.bound)


@pytest.mark.slow
def test_a_limit_that_may_be_reached_is_told(two_axes):
    reference = around_the_square(two_axes.dt)
    with pytest.raises(
        NotAffine, match=r"limit: a control of up to .* may reach its limit of 0\.1"
    ):
        certificate(Encoders(two_axes), offset_free(two_axes, 0.1), reference, BOX)


def test_the_control_under_that_against_friction_keeps_its_limit_too(two_axes):
    """It may be larger than their sum by all of the other."""
    plant = Encoders(two_axes)
    controller = FrictionFeedforward(offset_free(two_axes, 10.0), 0.5, limit=9.8)
    check_limits(plant, controller, np.full((5, 2), 9.4), BOX)
    for reached, limit in ((9.6, "10"), (9.9, "9.8")):
        with pytest.raises(NotAffine, match=f"may reach its limit of {limit}, first at sample 0"):
            check_limits(plant, controller, np.full((5, 2), reached), BOX)


@pytest.mark.slow
def test_a_limit_of_more_than_the_control_is_told():
    drive = servo_axes(gain=[50.0], pole=[10.0], dt=5e-3)
    loop = Cascade(CascadeGains(8.0, 0.6, 0.1), Sensors((0,), (1,)), drive.dt, limit=1e3)
    reference = along(line([0.0], [10e-3]), 5e-5 * np.arange(20), drive.dt, 1, at_rest=False)
    with pytest.raises(NotAffine, match=r"Cascade: .* \.limit limits more than the control"):
        certificate(drive, loop, reference, Box.of(0.01, 0.0, 1, 2))


@pytest.mark.slow
def test_a_box_for_another_loop_is_told(two_axes):
    with pytest.raises(ValueError, match="box: the loop has 2 controls and 2 measured numbers"):
        certificate(
            Encoders(two_axes),
            offset_free(two_axes),
            around_the_square(two_axes.dt),
            Box.of(0.1, 0.1, inputs=2, measured=4),
        )


def test_swapped_arguments_are_told(two_axes):
    words = r"^certificate\(plant, controller, reference\): the plant needs to be a Plant, received"
    with pytest.raises(TypeError, match=f"{words}|Type-check error"):
        certificate(
            offset_free(two_axes),  # pyright: ignore[reportArgumentType]
            Encoders(two_axes),  # pyright: ignore[reportArgumentType]
            around_the_square(two_axes.dt),
            BOX,
        )

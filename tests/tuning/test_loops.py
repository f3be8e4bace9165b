import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.sensitivity import encoding_of, probe_windows
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    kalman_gain,
    offset_free_gain,
)
from jcontour.geometry.contours import circle, line, polygon
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.references import along
from jcontour.plants.actuation import Delayed
from jcontour.plants.encoders import Encoders, FineEncoders
from jcontour.plants.flexible_axis.axis import SmoothFlexibleAxis, thesis_axis
from jcontour.plants.linear_machines import bridgeport
from jcontour.sensors import motors
from jcontour.simulation.evaluation import stack_plants, stack_references
from tuning.loops import ProbedLoops, _different
from tuning.objectives import mean_contour_error
from tuning.parameters import Positive
from tuning.point import looked_at
from tuning.problem import Problem


def central_differences(function, point, step=3e-3):
    """Slopes of fourth order, (outputs, inputs)."""
    columns = []
    for direction in step * np.eye(point.size):
        near, far = (
            (function(point + k * direction) - function(point - k * direction)) / (2 * k * step)
            for k in (1, 2)
        )
        columns.append((4 * near - far) / 3)
    return np.stack(columns, axis=1)


def check_slopes(build, start, family, windows):
    """Sums of all peaks and radii, so that every loop counts, against central differences."""
    loops = ProbedLoops(windows, encoding_of(family, windows), more=2)

    def matrices(z):
        return loops.matrices(family, build(z))

    @jax.jit
    def moving(z):
        return matrices(z), jax.jacfwd(matrices)(z)

    def looked(z):
        seen, moved = loops.look(*jax.device_get(moving(z)))
        peaks = zip((*seen.loops[:3], seen.late), (*moved.loops[:3], moved.late), strict=True)
        sums = [(np.sum(value), slope.sum(axis=(0, 1))) for value, slope in peaks]
        return tuple(map(np.stack, zip(*sums, strict=True)))

    values, slopes = looked(start)
    assert np.isfinite(values).all()
    wanted = central_differences(lambda z: looked(z)[0], start)
    largest = np.abs(wanted).max(axis=1, keepdims=True)
    np.testing.assert_allclose(slopes / largest, wanted / largest, rtol=1e-5, atol=1e-6)


def late_table():
    """Table with and without two samples of delay, probed around a square."""
    machine = bridgeport()
    family = [Delayed(Encoders(machine), jnp.asarray(late), 2, 2) for late in (0, 2)]
    square = polygon(1e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))
    run = along(square, 5e-5 * np.arange(60), machine.dt, 10, at_rest=False)
    return machine, stack_plants(family), probe_windows(stack_references([run]), 3)


def behind_filter(machine):
    def build(numbers):
        alpha, beta, noise = jnp.exp(numbers)
        inner = ContouringLQ(machine, LQWeights(alpha, beta, 2e-9), 10)
        return FilterObserver(inner, machine, kalman_gain(machine, noise, 3e-7))

    return build, np.log([0.03, 0.1, 0.1])


def behind_offset_free(machine):
    model = with_input_delay(machine, 1)

    def build(numbers):
        alpha, beta, noise, drift = jnp.exp(numbers)
        gain = offset_free_gain(model, model.C, noise, drift, 3e-7)
        inner = ContouringLQ(model, LQWeights(alpha, beta, 2e-9), 10)
        return OffsetFreeObserver(inner, model, gain, model.C, 10.0)

    return build, np.log([1.0, 3.0, 0.1, 1e-3])


@pytest.mark.slow
@pytest.mark.parametrize("behind", [behind_filter, behind_offset_free])
def test_slopes_on_the_table_with_delay(behind):
    machine, family, windows = late_table()
    check_slopes(*behind(machine), family, windows)


@pytest.mark.slow
def test_slopes_of_a_cascade_on_the_flexible_axis():
    dt = 1e-3
    axis = SmoothFlexibleAxis(thesis_axis(), dt, substeps=4)
    late = [Delayed(axis, jnp.asarray(late), 1, 1) for late in (0, 1)]
    family = stack_plants([FineEncoders(plant, motors(1)) for plant in late])
    run = along(line([0.0], [1e-2]), 1e-4 * np.arange(30), dt, 1, at_rest=False)
    windows = probe_windows(stack_references([run]), 2)

    def build(numbers):
        return Cascade(CascadeGains(*jnp.exp(numbers)), motors(1), dt, limit=10.0)

    check_slopes(build, np.log([30.0, 55.0, 0.04]), family, windows)


def test_probes_that_are_alike_count_as_each_alone(two_axes):
    family = stack_plants([Encoders(two_axes)])
    run = along(circle(1e-3), 3e-4 * np.arange(12), 1e-3, 3, at_rest=False)
    loops = ProbedLoops.of(family, stack_references([run]), 3, more=1, count=1e-6)

    def matrices(z):
        inner = ContouringLQ(two_axes, LQWeights(*jnp.exp(z), 1e-6), 3)
        return loops.matrices(family, FilterObserver(inner, two_axes, gain))

    gain = kalman_gain(two_axes, 0.01, 1e-6)
    z = jnp.log(jnp.array([3.0, 5.0]))
    both = jax.device_get((matrices(z), jax.jacfwd(matrices)(z)))
    assert _different(*both) == ([0, 1, 2], [0, 1, 2])  # the contour turns
    mixed = [1, 0, 1, 1, 2, 0]
    repeated = [jax.tree.map(lambda leaf: leaf[mixed], one) for one in both]
    assert _different(*repeated) == ([0, 1, 4], [0, 1, 0, 0, 2, 1])
    alone = [
        loops.look(*(jax.tree.map(lambda leaf, k=k: leaf[k : k + 1], one) for one in both))
        for k in mixed
    ]
    wanted = jax.tree.map(lambda *rows: np.concatenate(rows), *alone)
    for one, other in zip(
        jax.tree.leaves(loops.look(*repeated)), jax.tree.leaves(wanted), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)


def test_every_encoder_has_its_own_count(two_axes):
    """Mean squares are linear in the squares of the counts."""
    family = stack_plants([Encoders(two_axes)])
    run = along(circle(1e-3), 3e-4 * np.arange(12), 1e-3, 3, at_rest=False)
    controller = FilterObserver(
        ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3),
        two_axes,
        kalman_gain(two_axes, 0.01, 1e-6),
    )

    def variance(count):
        loops = ProbedLoops.of(family, stack_references([run]), 2, count=count)
        matrices = jax.device_get(loops.matrices(family, controller))
        none = jax.tree.map(lambda leaf: np.zeros((*leaf.shape, 1)), matrices)
        return np.asarray(loops.look(matrices, none)[0].count_noise) ** 2

    mixed = variance(np.array([1e-6, 5e-6])) + variance(np.array([5e-6, 1e-6]))
    np.testing.assert_allclose(mixed, variance(1e-6) + variance(5e-6), rtol=1e-9)
    assert np.all(variance(np.array([1e-6, 5e-6])) > 1.5 * variance(1e-6))


@pytest.mark.slow
def test_beside_a_gpu_they_are_looked_at_on_the_cpu(two_axes, monkeypatch):
    """Its kernels have a reverse mode only, and the matrices move in forward mode."""
    family = stack_plants([Encoders(two_axes)])
    run = along(circle(1e-3), 3e-4 * np.arange(12), 1e-3, 3, at_rest=False)
    references = stack_references([run])
    start = {"alpha": jnp.asarray(3.0), "beta": jnp.asarray(5.0)}

    def build(weights):
        inner = ContouringLQ(two_axes, LQWeights(weights["alpha"], weights["beta"], 1e-6), 3)
        return FilterObserver(inner, two_axes, gain)

    gain, z = kalman_gain(two_axes, 0.01, 1e-6), np.log([3.0, 5.0])
    problem = Problem(
        build=build,
        space={name: Positive() for name in start},
        plants=family,
        references=references,
        objective=mean_contour_error,
        loops=ProbedLoops.of(family, references, 2),
    )
    wanted = looked_at(problem, start, z)
    jax.clear_caches()
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    jax.tree.map(np.testing.assert_array_equal, looked_at(problem, start, z), wanted)

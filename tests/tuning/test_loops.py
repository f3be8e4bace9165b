import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.sensitivity import late_radius, loop_peaks
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import FilterObserver, kalman_gain
from jcontour.geometry.contours import circle
from jcontour.motion.references import along
from jcontour.plants.delays import Delayed
from jcontour.plants.encoders import Encoders
from jcontour.simulation.evaluation import stack_plants, stack_references
from tuning.loops import ProbedLoops, _different
from tuning.objectives import mean_contour_error
from tuning.parameters import Positive
from tuning.point import looked_at
from tuning.problem import Problem


@pytest.mark.slow
def test_peaks_and_slopes_are_those_of_loop_peaks(two_axes):
    """In reverse mode, through the program; here in forward mode, on the host."""
    family = stack_plants([Delayed(Encoders(two_axes), jnp.asarray(late), 1, 2) for late in (0, 1)])
    run = along(circle(1e-3), 3e-4 * np.arange(12), 1e-3, 3, at_rest=False)
    loops = ProbedLoops.of(family, stack_references([run]), 2, more=2)

    def controller(z):
        inner = ContouringLQ(two_axes, LQWeights(*jnp.exp(z[:2]), 1e-6), 3)
        return FilterObserver(inner, two_axes, kalman_gain(two_axes, jnp.exp(z[2]), 1e-6))

    def matrices(z):
        return loops.matrices(family, controller(z))

    z = jnp.log(jnp.array([3.0, 5.0, 0.01]))
    looked, moved = loops.look(*jax.device_get((matrices(z), jax.jacfwd(matrices)(z))))
    found, late, slopes, late_slopes = looked.peaks, looked.late, moved.peaks, moved.late
    assert looked.count_noise is None

    def wanted(z):
        return loop_peaks(family, controller(z), loops.windows)

    for one, other in zip(found, wanted(z), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    for one, other in zip(slopes, jax.jacrev(wanted)(z), strict=True):
        assert one.shape == (2, 2, 3)
        # a peak is flat: its frequency and the slope there have fewer digits than its height
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6 * np.abs(other).max())

    def wanted_late(z):
        radii = [late_radius(family, controller(z), loops.windows, d) for d in (1, 2)]
        return jnp.maximum(*radii)

    np.testing.assert_allclose(late, wanted_late(z), rtol=1e-9)
    np.testing.assert_allclose(late_slopes, jax.jacrev(wanted_late)(z), rtol=1e-6, atol=1e-9)


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

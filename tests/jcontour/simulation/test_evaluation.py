import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, line, polyline
from jcontour.linear.transformations import with_input_gains
from jcontour.motion.references import along
from jcontour.plant import Plant
from jcontour.plants.actuation import Delayed
from jcontour.plants.flexible_axis.axis import SmoothFlexibleAxis, thesis_axis
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import (
    Numbered,
    all_at_once,
    evaluate,
    family_batching,
    member,
    one_by_one,
    platform_batching,
    stack_plants,
    stack_references,
)
from jcontour.simulation.metrics import score
from tests.small_loops import Proportional

WINDOW = (2, 8)
CHECKED = "Type-check error"  # what a checker of annotations says


@pytest.fixture(scope="module")
def controller(two_axes):
    return ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3)


@pytest.fixture(scope="module")
def plants(two_axes):
    return [
        Delayed(with_input_gains(two_axes, gains), d, 2, 2)
        for gains, d in ((1.0, 0), ((0.9, 1.1), 0), (1.0, 2))
    ]


@pytest.fixture(scope="module")
def references():
    """Different shapes, lengths, sizes and numbers of pieces; one scored in part."""
    corners = polyline([[0, 0], [4e-5, 0], [4e-5, 5e-5], [0, 5e-5]])
    return [
        along(circle(1e-3), 1e-5 * np.arange(9), 1e-3, 3, at_rest=False),
        along(corners, 1e-5 * np.arange(13), 1e-3, 3, at_rest=True, scored=np.arange(13) != 5),
        along(line([1e-3, 0], [2e-3, 1e-3]), 2e-5 * np.arange(11), 1e-3, 3, at_rest=False),
    ]


@pytest.fixture(scope="module")
def evaluated(controller, plants, references):
    batch = stack_plants(plants), stack_references(references)
    return {
        b.__name__: jax.jit(lambda c, p, r, b=b: evaluate(p, c, r, WINDOW, b))(controller, *batch)
        for b in (one_by_one, all_at_once)
    }


def test_flexible_axes_run_side_by_side_and_linear_plants_as_the_platform_likes(plants):
    axes = stack_plants(
        [Delayed(SmoothFlexibleAxis(thesis_axis(), 1e-3), jnp.asarray(d), 2, 1) for d in (0, 2)]
    )
    assert (
        family_batching(axes) is all_at_once
        and family_batching(stack_plants(plants)) is platform_batching()
    )


def test_metrics_are_those_of_single_runs(evaluated, controller, plants, references):
    family = jax.device_get(evaluated["one_by_one"])
    for i, reference in enumerate(references[:2]):
        for j in (0, 2):
            wanted = score(simulate(plants[j], controller, reference), reference, WINDOW)
            actual = jax.tree.map(lambda leaf, i=i, j=j: leaf[i, j], family)
            for a, b in zip(jax.tree.leaves(actual), jax.tree.leaves(wanted), strict=True):
                np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-18)


def test_one_by_one_is_all_at_once(evaluated):
    for a, b in zip(
        *(jax.tree.leaves(evaluated[name]) for name in ("one_by_one", "all_at_once")), strict=True
    ):
        assert a.shape == (3, 3)
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-18)


def test_platform_chooses():
    assert platform_batching() is (one_by_one if jax.default_backend() == "cpu" else all_at_once)


def test_stacking_keeps_every_run(references):
    stacked = stack_references(references)
    assert (stacked.steps, stacked.preview) == (13, 3)
    for i, reference in enumerate(references):
        one = member(stacked, i)
        rows = reference.steps + reference.preview
        np.testing.assert_array_equal(one.position[:rows], reference.position)
        assert int(one.mask.sum()) == int(reference.mask.sum())
        arc = 0.7 * reference.arc[:5] + 1e-6
        np.testing.assert_allclose(
            one.contour.position(arc), reference.contour.position(arc), atol=1e-18
        )


class Drives(Plant):
    """Two drives that take a speed, y' = u; no field is an array."""

    dt: float = eqx.field(static=True, default=1e-3)

    def initial_state(self, position, increment):
        return position

    def step(self, state, control):
        return state + self.dt * control

    def output(self, state):
        return state


@pytest.mark.parametrize(("count", "batching"), [(1, one_by_one), (3, all_at_once)])
def test_plants_without_arrays_are_as_many_as_were_stacked(count, batching, references):
    runs = stack_references([references[0]])
    actual = evaluate(stack_plants([Drives()] * count), Proportional(50.0), runs, batching=batching)
    wanted = score(simulate(Drives(), Proportional(50.0), references[0]), references[0])
    assert actual.rms_contour_error.shape == (1, count)
    np.testing.assert_allclose(actual.rms_contour_error, wanted.rms_contour_error, rtol=1e-12)


def test_plants_without_arrays_that_differ_or_are_not_stacked_are_refused(references):
    with pytest.raises(ValueError, match=r"number 1 differs from number 0 in dt, 0.002 and 0.001"):
        stack_plants([Drives(), Drives(2e-3)])
    with pytest.raises(ValueError, match=r"plants: needs a stack"):
        evaluate(Drives(), Proportional(50.0), stack_references([references[0]]))


ARC = 1e-5 * np.arange(9)


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (
            along(circle(1e-3), ARC, 1e-3, 4, at_rest=False),
            "number 1 has a preview of 4 samples, number 0 has a preview of 3 samples",
        ),
        (
            along(circle(1e-3), ARC, 2e-3, 3, at_rest=False),
            "number 1 has a sample period of 0.002 s, number 0 has a sample period of 0.001 s",
        ),
        (
            along(line([0, 0, 0], [1e-3, 0, 0]), ARC, 1e-3, 3, at_rest=False),
            "number 1 has 3 axes, number 0 has 2 axes",
        ),
        (
            stack_references([along(circle(1e-3), ARC, 1e-3, 3, at_rest=False)] * 2),
            "number 1 is a stack of 2 already",
        ),
    ],
)
def test_runs_that_do_not_stack_are_told_with_what_differs(references, other, words):
    with pytest.raises(ValueError, match=f"references: {words}"):
        stack_references([references[0], other])


def test_a_stack_of_no_runs_is_refused():
    with pytest.raises(ValueError, match="references: needs at least one, received none"):
        stack_references([])


def test_what_sets_a_plant_apart_from_the_first_is_told(two_axes, plants):
    late = Delayed(two_axes, 0, 3, 2)
    for others, words in (
        ([plants[0], two_axes], "number 1 differs from number 0 in its kind, LinearPlant and Del"),
        ([plants[0], plants[1], late], "number 2 differs from number 0 in "),
        ([], "plants: "),
    ):
        with pytest.raises(ValueError, match=words):
            stack_plants(others)


def test_swapped_arguments_and_what_is_not_stacked_are_told(controller, plants, references):
    family, runs = stack_plants(plants), stack_references(references)
    for given, words in (
        ((controller, family, runs), "the plants need to be a Plant, received ContouringLQ"),
        ((family, runs, controller), "the controller needs to be a Controller, received Reference"),
    ):
        with pytest.raises(TypeError, match=rf"^evaluate\(plants, controller, .*{words}|{CHECKED}"):
            evaluate(*given)
    for given, words in (
        ((plants[0], controller, runs), r"plants: needs a stack, as stack_plants\(\[...\]\) makes"),
        ((family, controller, references[0]), "references: needs a stack, as stack_references"),
    ):
        with pytest.raises(ValueError, match=words):
            evaluate(*given)


def test_the_memory_of_a_derivative_does_not_grow_with_the_batch():
    def value(scale, members):
        def one(x):
            return jnp.sum(jax.lax.scan(lambda y, _: (jnp.sin(scale * y),) * 2, x, length=100)[1])

        return jnp.sum(one_by_one(one, members))

    def compiled(size):
        members = jnp.linspace(0, 1, 10 * size).reshape(size, 10)
        return jax.jit(jax.grad(value)).lower(1.1, members).compile(), members

    (few, _), (many, members) = compiled(1), compiled(1024)
    assert many.memory_analysis().temp_size_in_bytes <= 2 * few.memory_analysis().temp_size_in_bytes
    alone = [few(1.1, members[k : k + 1]) for k in range(0, 1024, 64)]
    np.testing.assert_allclose(compiled(16)[0](1.1, members[::64]), sum(alone), rtol=1e-12)
    np.testing.assert_allclose(
        many(1.1, jnp.repeat(members[::64], 64, axis=0)), 64 * sum(alone), rtol=1e-11
    )


def test_a_number_changes_nothing(two_axes):
    place, increment = jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0])
    control = jnp.array([0.3, -0.2])
    actual, wanted = [], []
    for plant, rows in ((Numbered(two_axes, 3), actual), (two_axes, wanted)):
        state = plant.step(plant.initial_state(place, increment), control)
        rows += [state, plant.output(state), plant.measure(state), plant.holding_control(place)]
    for a, b in zip(jax.tree.leaves(actual), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_array_equal(a, b)
    assert Numbered(two_axes, 3).dt == two_axes.dt
    assert Numbered(two_axes, 3).side_by_side is two_axes.side_by_side

import equinox as eqx
import jax
import numpy as np
import pytest

from jcontour.controller import Controller
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, line
from jcontour.motion.references import along
from jcontour.plant import Plant
from jcontour.plants.encoders import Encoders
from jcontour.simulation.closed_loop import check_run, follow, prepared, simulate, start_state
from jcontour.simulation.evaluation import stack_plants, stack_references

PREVIEW = 3
CHECKED = "Type-check error"  # what a checker of annotations says


@pytest.fixture(scope="module")
def controller(two_axes):
    return ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), PREVIEW)


def reference_of(at_rest=False, preview=PREVIEW, dt=1e-3):
    return along(circle(1e-3), 1e-5 * np.arange(8), dt, preview, at_rest)


def test_rows_are_those_of_a_plain_loop(two_axes, controller):
    """Row k is taken before control k acts."""
    reference = reference_of()
    rollout = jax.device_get(simulate(two_axes, controller, reference))
    plan = prepared(controller, reference)
    A, B, C, F, f = (np.asarray(m) for m in (two_axes.A, two_axes.B, two_axes.C, plan.F, plan.f))
    x = np.asarray(start_state(two_axes, reference))
    for k in range(reference.steps):
        np.testing.assert_allclose(rollout.state[k], x, rtol=1e-12, atol=1e-17)
        np.testing.assert_allclose(rollout.output[k], C @ x, rtol=1e-12, atol=1e-17)
        np.testing.assert_array_equal(rollout.measurement[k], rollout.state[k])
        u = f[k] - F[k] @ x
        np.testing.assert_allclose(rollout.control[k], u, rtol=1e-10, atol=1e-13)
        x = A @ x + B @ u
    np.testing.assert_allclose(rollout.final_state, x, rtol=1e-12, atol=1e-17)
    assert rollout.memory is None and rollout.final_memory is None


def test_start_is_what_the_reference_says_or_what_is_given(two_axes, controller):
    at_rest = jax.device_get(simulate(two_axes, controller, reference_of(at_rest=True)))
    np.testing.assert_allclose(
        two_axes.step(at_rest.state[0], np.zeros(2)), at_rest.state[0], rtol=0, atol=1e-18
    )
    np.testing.assert_allclose(at_rest.output[0], [1e-3, 0.0], atol=1e-18)
    given = np.array([1e-3, 2e-3, 3e-3, 4e-3])
    state = simulate(two_axes, controller, reference_of(), given).state
    np.testing.assert_array_equal(np.asarray(state)[0], given)


def test_more_preview_than_needed_changes_nothing(two_axes, controller):
    short, long = (
        simulate(two_axes, controller, reference_of(preview=n)) for n in (PREVIEW, PREVIEW + 4)
    )
    np.testing.assert_allclose(long.control, short.control, rtol=1e-13)


def test_a_reference_that_does_not_suit_is_refused(two_axes, controller):
    with pytest.raises(
        ValueError,
        match="preview: the controller looks 3 samples ahead, the reference was made with 2",
    ):
        simulate(two_axes, controller, reference_of(preview=2))
    with pytest.raises(
        ValueError, match="dt: the plant is sampled every 0.001 s, the reference every 0.002 s"
    ):
        simulate(two_axes, controller, reference_of(dt=2e-3))
    check_run(two_axes, controller, reference_of())


def test_the_plain_numbers_of_a_family_are_all_alike(controller):
    """A plant whose sample period and axes are no static fields, stacked."""

    class Drifting(Plant):
        dt: float = 1e-3
        axes: int = 2

        def initial_state(self, position, increment):
            return position

        def step(self, state, control):
            return state + self.dt * control

        def output(self, state):
            return state

    family = stack_plants([Drifting(), Drifting()])
    check_run(family, controller, reference_of())
    with pytest.raises(ValueError, match="dt: the plant is sampled every 0.001 s, the reference"):
        check_run(family, controller, reference_of(dt=2e-3))
    three = stack_plants([Drifting(axes=3), Drifting(axes=3)])
    with pytest.raises(ValueError, match="it has 2 axes, the plant 3"):
        check_run(three, controller, reference_of())


def test_a_plan_can_be_shared(two_axes, controller):
    reference = reference_of()
    shared = eqx.filter_jit(follow)(
        two_axes, controller, prepared(controller, reference), reference
    )
    wanted = simulate(two_axes, controller, reference)
    for actual, row in zip(jax.tree.leaves(shared), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(actual, row, rtol=1e-11, atol=1e-15)


def test_swapped_arguments_are_told(two_axes, controller):
    reference = reference_of()
    for given, words in (
        ((controller, two_axes, reference), "the plant needs to be a Plant, received ContouringLQ"),
        ((two_axes, reference, controller), "the controller needs to be a Controller, received Re"),
        ((two_axes, controller, None), "the reference needs to be a Reference, received NoneType"),
    ):
        with pytest.raises(TypeError, match=f"{words}|{CHECKED}"):
            simulate(*given)


class Ahead(Controller):
    """Its plan has rows for the samples that it sees ahead, too."""

    preview: int = eqx.field(static=True, default=PREVIEW)

    def prepare(self, reference):
        return reference.position

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        return memory, plan


class Planless(Ahead):
    def prepare(self, reference):
        return None


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Ahead, r"8 control steps, received shape \(11, 2\), all samples with their preview"),
        (Planless, r"8 control steps, received shape \(\)"),
    ],
)
def test_a_plan_without_a_row_for_every_step_is_told_with_prepare(two_axes, kind, words):
    with pytest.raises(ValueError, match=f"^prepare: {kind.__name__} needs to return .*{words}"):
        simulate(two_axes, kind(), reference_of())


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (np.zeros(3), r"the initial state needs shape \(4,\), received \(3,\)"),
        (np.zeros((2, 4)), r"the initial state needs shape \(4,\), received \(2, 4\)"),
        ((np.zeros(2), np.zeros(2)), "the initial state needs to be built as .* received tuple"),
    ],
)
def test_an_initial_state_of_another_plant_is_refused(two_axes, controller, state, words):
    with pytest.raises(ValueError, match=words):
        simulate(two_axes, controller, reference_of(), state)


def test_whole_numbers_are_an_initial_state(two_axes, controller):
    whole, exact = (
        simulate(two_axes, controller, reference_of(), np.array([1, 0, 2, 0], kind)).output
        for kind in (int, float)
    )
    np.testing.assert_array_equal(whole, exact)


def test_a_contour_with_other_axes_than_the_plant_is_refused(two_axes, controller):
    space = along(line([0, 0, 0], [1e-3, 0, 0]), 1e-5 * np.arange(8), 1e-3, PREVIEW, at_rest=False)
    for plant in (two_axes, Encoders(two_axes)):
        with pytest.raises(ValueError, match="reference: it has 3 axes, the plant 2"):
            simulate(plant, controller, space)


def test_a_stack_of_references_is_for_evaluate(two_axes, controller):
    with pytest.raises(ValueError, match="simulate runs one, received a stack of 2; evaluate"):
        simulate(two_axes, controller, stack_references([reference_of()] * 2))

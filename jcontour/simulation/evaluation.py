"""One controller on many contours and many plants: metrics with axes (contour, plant).

The plan is prepared once per contour and shared by the family. On a CPU the batches are loops
(`lax.map`: one run stays in the cache, and memory does not grow with the batch), on an accelerator
they are vectorised (`vmap`).
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol, TypeGuard, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jcontour import _kernels as kernels
from jcontour.controller import Controller, Plan
from jcontour.geometry.contours import stack as stack_contours
from jcontour.linear.plant import AffinePlan, LinearPlant, operating_point
from jcontour.motion.references import Reference, pad
from jcontour.plant import Plant, Wrapper
from jcontour.riccati.decoupled import ContouringProblem, decoupled_plan
from jcontour.simulation.closed_loop import check_kinds, check_run, follow
from jcontour.simulation.metrics import score_signals

# Members whose intermediate numbers a derivative may keep: about 1 MB each for 500 steps. Beyond,
# it runs them again, which costs 40 % of its time.
KEPT = 16
# (function of one member, batch of members with axis 0 in front) -> batch of results
Batching = Callable[[Callable, Any], Any]
# (output, control, reference, window) of one run -> arrays
Score = Callable[[Any, Any, Reference, tuple[int, int] | None], Any]

# what runs that are stacked have in common
OBSERVED: dict[str, Callable[[Reference], Any]] = {
    "{} axes": lambda reference: reference.position.shape[1],
    "a preview of {} samples": lambda reference: reference.preview,
    "a sample period of {} s": lambda reference: reference.dt,
}


@runtime_checkable
class DecoupledLaw(Protocol):
    """A controller whose run needs no gains where axes are decoupled; see `riccati.decoupled`."""

    def decoupled_problem(self, reference: Reference) -> ContouringProblem | None:
        """Problem of a run; None where it needs gains."""


@runtime_checkable
class AffineLaw(Protocol):
    """A controller whose control is u = f - F x of its plan and nothing else."""

    follows_its_plan: bool


def one_by_one(function: Callable, members: Any) -> Any:
    """Batch by `lax.map`: memory of a single member, fastest on a CPU.

    The derivative of a large batch runs every member a second time, to save its memory.
    """
    size = jnp.shape(jax.tree.leaves(members)[0])[0]
    return jax.lax.map(jax.checkpoint(function) if size > KEPT else function, members)


def all_at_once(function: Callable, members: Any) -> Any:
    """Batch by `vmap`: fastest on an accelerator."""
    return jax.vmap(function)(members)


def platform_batching() -> Batching:
    """Batching that suits the platform: `one_by_one` on a CPU, `all_at_once` elsewhere."""
    return one_by_one if jax.default_backend() == "cpu" else all_at_once


def family_batching(plants: Plant) -> Batching:
    """Batching of a family: that of the platform, unless the plants run faster side by side."""
    return all_at_once if plants.side_by_side else platform_batching()


def evaluate(
    plants: Plant,
    controller: Controller,
    references: Reference,
    window: tuple[int, int] | None = None,
    batching: Batching | None = None,
    score: Score = score_signals,
) -> Any:
    """Metrics (contour, plant) of one controller, over stacked references and stacked plants.

    >>> from jcontour import contours, feed_laws, references
    >>> from jcontour.controllers import ContouringLQ, LQWeights
    >>> from jcontour.linear.transformations import with_input_gains
    >>> from jcontour.plants import bridgeport
    >>> machine, path = bridgeport(), contours.circle(1e-3)
    >>> controller = ContouringLQ(machine, LQWeights(3.0, 5.0, 1e-6), preview=5)
    >>> family = stack_plants([machine, with_input_gains(machine, [0.9, 1.1])])
    >>> arc = feed_laws.constant_feed(path, 10e-3, machine.dt)
    >>> reference = references.along(path, arc, machine.dt, preview=5, at_rest=False)
    >>> metrics = evaluate(family, controller, stack_references([reference]))
    >>> metrics.rms_contour_error.shape
    (1, 2)

    Args:
        plants: `stack_plants([...])`, axis 0.
        controller: prepared once per contour.
        references: `stack_references([...])`, axis 0.
        window: samples a..b-1 that are scored; all when not given.
        batching: how contours are batched, on one device or on several (`devices.Spread`); chosen
            by the platform when not given.
        score: (output, control, reference, window) -> any arrays of one run, in the place of its
            metrics.

    Raises:
        ValueError: as `simulate` and `score`, or plants or references are not stacked.
        TypeError: the arguments are swapped, or of another kind.
    """
    check_kinds("evaluate", plants=plants, controller=controller, references=references)
    _check_stack("plants", plants)
    _check_stack("references", references)
    check_run(plants, controller, references)
    each = family_batching(plants)
    batching = platform_batching() if batching is None else batching

    def on_contour(reference: Reference) -> Any:
        if score is score_signals and (run := _without_gains(plants, controller, reference)):
            return each(lambda plant: run(plant, window), plants)
        plan = controller.prepare(reference)
        in_jax = partial(_followed, controller=controller, window=window, score=score)
        follows = isinstance(controller, AffineLaw) and isinstance(plan, AffinePlan)
        if score is score_signals and follows and _by_kernels(plants):
            from jcontour._kernels import affine_runs  # loads Warp

            if affine_runs.suits_run(plants, reference):
                run = partial(affine_runs.metrics, in_jax=in_jax, window=window)
                return each(lambda plant: run(plan, plant, reference), plants)
        return each(lambda plant: in_jax(plan, plant, reference), plants)

    return batching(on_contour, references)


def _by_kernels(plants: Plant) -> TypeGuard[LinearPlant]:
    """Whether kernels may take runs of the plants: a wrapper may measure less than the state."""
    return kernels.enabled() and type(plants) is LinearPlant


def _without_gains(plants: Plant, controller: Controller, reference: Reference) -> Any:
    """Metrics by a kernel, a function of plant and window; None where no kernel takes the run."""
    if not (_by_kernels(plants) and isinstance(controller, DecoupledLaw)):
        return None
    problem = controller.decoupled_problem(reference)
    if problem is None:
        return None
    from jcontour._kernels import lq_metrics  # loads Warp

    if not lq_metrics.suits(problem, plants, reference):
        return None

    def in_jax(problem, plant, reference, window):
        at = operating_point(problem.model, reference.position[0])
        moved = eqx.tree_at(lambda one: one.y_d, problem, problem.y_d - at.position[None])
        plan = decoupled_plan(moved).at(at)
        return _followed(plan, plant, reference, controller, window, score_signals)

    return lambda plant, window: lq_metrics.metrics(
        problem, plant, reference, window, partial(in_jax, window=window)
    )


def _followed(
    plan: Plan,
    plant: Plant,
    reference: Reference,
    controller: Controller,
    window: tuple[int, int] | None,
    score: Score,
) -> Any:
    """Score of one run."""
    rollout = follow(plant, controller, plan, reference)
    return score(rollout.output, rollout.control, reference, window)


def stack_plants(plants: Sequence[Plant]) -> Plant:
    """A family: plants of the same structure, stacked on axis 0.

    Plants whose fields are all static are equal; they are `Numbered`, to be as many.

    >>> machine = LinearPlant([[1.0]], [[1e-3]], [[1.0]], dt=1e-3)
    >>> stack_plants([machine, machine, machine]).A.shape
    (3, 1, 1)

    Raises:
        ValueError: none given, or their structures differ.
    """
    family = _stack("plants", plants)
    return family if jax.tree.leaves(family) else Numbered(family, np.arange(len(plants)))


def stack_references(references: Sequence[Reference]) -> Reference:
    """Runs of different length and shape, padded and stacked on axis 0.

    Raises:
        ValueError: none given, or their preview, sample period or number of axes differ.
    """
    if not references:
        raise ValueError("references: needs at least one, received none")
    for k, one in enumerate(references):
        if one.position.ndim != 2:
            raise ValueError(f"references: number {k} is a stack of {len(one.position)} already")
        for words, of in OBSERVED.items():
            if of(one) != of(references[0]):
                raise ValueError(
                    f"references: number {k} has {words.format(of(one))}, "
                    f"number 0 has {words.format(of(references[0]))}"
                )
    steps = max((reference.steps for reference in references), default=0)
    contours = jax.device_get(stack_contours([reference.contour for reference in references]))

    def alike(index: int) -> Reference:
        padded = pad(references[index], steps)
        return eqx.tree_at(lambda r: r.contour, padded, member(contours, index))

    return _stack("references", [alike(index) for index in range(len(references))])


def member(batch: Any, index: int) -> Any:
    """One member of a stacked batch."""
    return jax.tree.map(lambda leaf: leaf[index], batch)


def _check_stack(name: str, members: Any) -> None:
    """Raise ValueError unless all arrays have the members on axis 0."""
    shapes = [np.shape(leaf) for leaf in jax.tree.leaves(members)]
    if len({shape[:1] for shape in shapes}) != 1 or () in shapes:
        raise ValueError(f"{name}: needs a stack, as stack_{name}([...]) makes it, received one")


def _stack(name: str, members: Sequence) -> Any:
    if not members:
        raise ValueError(f"{name}: needs at least one, received none")
    shapes = [jax.tree.map(jnp.shape, one) for one in members]
    first = jax.tree.structure(members[0])
    for k, one in enumerate(members):
        if jax.tree.structure(one) != first or shapes[k] != shapes[0]:
            raise ValueError(
                f"{name}: all need the same structure, sample period and shapes; "
                f"number {k} differs from number 0 in {_difference(one, members[0])}"
            )
    # stacked by NumPy, and put in place as they are: nothing to compile
    return jax.tree.map(lambda *leaves: jax.device_put(np.stack(leaves)), *members)


def _difference(one: Any, first: Any) -> str:
    """What sets a member apart from the first, in a few words."""
    if type(one) is not type(first):
        return f"its kind, {type(one).__name__} and {type(first).__name__}"
    for name, field in one.__dataclass_fields__.items():
        both = [getattr(member, name) for member in (one, first)]
        if field.metadata.get("static"):
            if both[0] != both[1]:
                return f"{name}, {both[0]} and {both[1]}"
            continue
        shapes = [[jnp.shape(leaf) for leaf in jax.tree.leaves(value)] for value in both]
        if shapes[0] != shapes[1]:
            return f"{name}, shapes {shapes[0]} and {shapes[1]}"
        if jax.tree.structure(both[0]) != jax.tree.structure(both[1]):
            return name
    return "its structure"


class Numbered(Wrapper):
    """A plant and a number that nothing reads.

    All fields of a plant may be static. Then a family of equal ones has no array whose axis 0
    counts them: their numbers do.

    >>> from jcontour.linear.plant import LinearPlant
    >>> drive = LinearPlant([[1.0]], [[1e-3]], [[1.0]], dt=1e-3)
    >>> Numbered(drive, 2).step(jnp.ones(1), jnp.ones(1)).tolist()
    [1.001]

    Args:
        plant: the machine.
        number: of the member, or (members,) of a family.
    """

    number: Int[Array, ""] | Int[Array, " members"] = eqx.field(converter=jnp.asarray)

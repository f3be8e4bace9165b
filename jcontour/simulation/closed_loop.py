"""The closed loop: plant and controller stepped together along a reference.

u(k), w(k+1) = controller(w(k), plan(k), measure(x(k)));   x(k+1) = plant(x(k), u(k))
"""

from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Float

from jcontour.controller import Controller, Plan, Sampled, check_preview
from jcontour.motion.references import Reference
from jcontour.plant import Plant, State
from jcontour.told_values import shape, told


class Rollout(eqx.Module):
    """A closed-loop run; row k is taken before control k acts."""

    state: Any
    output: Float[Array, "T m"]
    measurement: Any
    control: Float[Array, "T p"]
    memory: Any
    final_state: Any
    final_memory: Any

    def __repr__(self) -> str:
        control = f"control {shape(self.control)} from {told(self.control)}"
        return f"Rollout(output {shape(self.output)} [m], {control})"


def start_state(plant: Plant, reference: Reference) -> State:
    """State in which a run begins: at rest on the first sample, or in steady motion through it."""
    return plant.initial_state(reference.position[0], reference.start_increment)


def simulate(
    plant: Plant, controller: Controller, reference: Reference, state: State | None = None
) -> Rollout:
    """Run `controller` on `plant` along `reference` for its T steps.

    The run starts in `state`, or as the reference begins when none is given. Nothing is raised for
    a loop that is unstable: its numbers grow, to NaN at last, and `score` tells it as `diverged`.

    >>> from jcontour import contours, feed_laws, references
    >>> from jcontour.controllers import ContouringLQ, LQWeights
    >>> from jcontour.plants import bridgeport
    >>> machine, path = bridgeport(), contours.circle(1e-3)
    >>> controller = ContouringLQ(machine, LQWeights(3.0, 5.0, 1e-6), preview=5)
    >>> arc = feed_laws.constant_feed(path, 10e-3, machine.dt)
    >>> reference = references.along(path, arc, machine.dt, preview=5, at_rest=False)
    >>> rollout = simulate(machine, controller, reference)
    >>> rollout.output.shape == (reference.steps, 2)
    True

    Raises:
        ValueError: the reference has fewer preview samples than the controller needs, or their
            sample periods differ.
        TypeError: the arguments are swapped, or of another kind.
    """
    _check_kinds(plant, controller, reference)
    check_run(plant, controller, reference)
    return _simulated(plant, controller, reference, state)


@eqx.filter_jit
def _simulated(
    plant: Plant, controller: Controller, reference: Reference, state: State | None
) -> Rollout:
    return follow(plant, controller, controller.prepare(reference), reference, state)


@eqx.filter_jit
def prepared(controller: Controller, reference: Reference) -> Plan:
    """Plan of a controller for all T steps: a gain schedule, for instance.

    Raises:
        ValueError: the reference has fewer preview samples than the controller needs.
    """
    check_preview(controller, reference)
    return controller.prepare(reference)


def follow(
    plant: Plant,
    controller: Controller,
    plan: Plan,
    reference: Reference,
    state: State | None = None,
) -> Rollout:
    """Rollout with a plan that is prepared already, so that a family of plants can share it."""
    state = start_state(plant, reference) if state is None else state

    def step(carry, plan_k):
        state, memory = carry
        measurement = plant.measure(state)
        next_memory, control = controller.step(memory, plan_k, measurement)
        row = (state, plant.output(state), measurement, control, memory)
        return (plant.step(state, control), next_memory), row

    (final_state, final_memory), rows = jax.lax.scan(
        step, (state, controller.initial_memory(reference)), plan
    )
    return Rollout(*rows, final_state, final_memory)


def check_run(plant: Plant, controller: Sampled, reference: Reference) -> None:
    """Raise ValueError unless the reference suits the controller and the plant."""
    check_preview(controller, reference)
    if plant.dt != reference.dt:
        raise ValueError(
            f"dt: the plant is sampled every {plant.dt} s, the reference every {reference.dt} s"
        )


def _check_kinds(plant: Plant, controller: Sampled, reference: Reference) -> None:
    """Raise TypeError for arguments in another order."""
    given = {"plant": (plant, Plant), "controller": (controller, Controller)}
    for name, (one, kind) in {**given, "reference": (reference, Reference)}.items():
        if not isinstance(one, kind):
            raise TypeError(
                f"simulate(plant, controller, reference): the {name} needs to be a "
                f"{kind.__name__}, received {type(one).__name__}"
            )

"""Controllers that are slower than their loop, or have a control beside theirs.

One acts at every n-th sample and holds in between; what another finds acts one sample later.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from jcontour._arrays import placed, whole_number
from jcontour.controllers.feedforward.inverse_feedforward import FrictionFeedforward
from jcontour.host.controller import HostController, HostWrapper, Stepped, StepReport
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference


class HeldMemory(NamedTuple):
    """State of a held controller."""

    inner: Any  # memory of the wrapped controller
    control: Float[np.ndarray, " p"]  # its last control
    age: int  # samples for which that has acted
    report: StepReport  # of the step that found it


class Held(HostController):
    """`controller`, made for the sample period n dt, in a loop of the sample period dt.

    It is given every n-th sample of the reference. Machine and errors can then be looked at
    between its samples. A sample in between repeats the report of the step before it.

    Args:
        controller: on the host.
        every: n.
        inputs: number of controls p.

    Raises:
        ValueError: `every` is not a whole number of at least one.
    """

    def __init__(self, controller: HostController, every: int, inputs: int):
        self.every = whole_number("every", every, 1)
        self.controller, self.inputs = controller, int(inputs)
        self.preview = controller.preview * self.every

    def prepare(self, reference: Reference) -> Any:
        """Plan of the wrapped controller, each row for n samples."""
        plan = self.controller.prepare(thinned(reference, self.every))

        def repeated(rows):
            return np.repeat(np.asarray(rows), self.every, axis=0)[: reference.steps]

        return jax.tree.map(repeated, plan)

    def initial_memory(self, reference: Reference) -> HeldMemory:
        """Memory of the wrapped controller, which acts in the first sample."""
        inner = self.controller.initial_memory(thinned(reference, self.every))
        return HeldMemory(inner, np.zeros(self.inputs), 0, StepReport())

    def step(self, memory: HeldMemory, plan: Any, measurement: Any) -> Stepped:
        """The controller's own step at every n-th sample, its last control otherwise."""
        if memory.age > 0:
            older = memory._replace(age=(memory.age + 1) % self.every)
            return older, memory.control, memory.report
        return self._begun(self.controller.step(memory.inner, plan, measurement))

    def soft_step(self, memory: HeldMemory, plan: Any, measurement: Any) -> Stepped | None:
        answer = self.controller.soft_step(memory.inner, plan, measurement)
        return None if answer is None else self._begun(answer)

    def held(
        self, memory: HeldMemory, measurement: Any, control: Float[np.ndarray, " p"]
    ) -> HeldMemory:
        """Memory after the fallback: the repeated control is held for n samples too."""
        inner = self.controller.held(memory.inner, measurement, control)
        return HeldMemory(inner, control, 1 % self.every, StepReport())

    def finished(self, memory: HeldMemory) -> bool:
        return memory.age == 0 and self.controller.finished(memory.inner)

    def _begun(self, answer: Stepped) -> Stepped:
        inner, control, report = answer
        return HeldMemory(inner, control, 1 % self.every, report), control, report


def thinned(reference: Reference, every: int) -> Reference:
    """Every n-th sample of a reference, at n times its sample period.

    A last step that is cut off counts as a step.
    """
    steps = -(-reference.steps // every)
    samples = steps + reference.preview // every
    index = np.minimum(every * np.arange(samples), len(reference.position) - 1)
    position, tangent, arc, mask = (
        placed(np.asarray(values)[index])
        for values in (reference.position, reference.tangent, reference.arc, reference.mask)
    )
    return Reference(
        position,
        tangent,
        arc,
        mask,
        reference.start_increment * every,
        reference.contour,
        reference.dt * every,
        steps,
    )


class FrictionMemory(NamedTuple):
    """Memory of the wrapped controller, and what was added to its last control."""

    inner: Any
    friction: Float[np.ndarray, " p"]


class FrictionCompensated(HostController):
    """A controller, and what compensates friction and backlash beside it, in every kind of step.

    Args:
        controller: on the host.
        feedforward: what is added, and the limit of the sum.
        leading: the reference that both are planned for; the given one when not given.
    """

    def __init__(
        self,
        controller: HostController,
        feedforward: FrictionFeedforward,
        leading: Callable[[Reference], Reference] | None = None,
    ):
        self.controller, self.feedforward, self.leading = controller, feedforward, leading
        self.preview = max(controller.preview, feedforward.preview)
        self._limit = np.asarray(feedforward.limit)

    def prepare(self, reference: Reference) -> tuple[Any, Float[np.ndarray, "T p"]]:
        reference = reference if self.leading is None else self.leading(reference)
        friction = np.asarray(self.feedforward.against(reference))
        return self.controller.prepare(reference), friction

    def initial_memory(self, reference: Reference) -> FrictionMemory:
        none = np.zeros_like(np.asarray(self.feedforward.against(reference))[0])
        return FrictionMemory(self.controller.initial_memory(reference), none)

    def step(self, memory: FrictionMemory, plan: Any, measurement: Any) -> Stepped:
        return self._beside(self.controller.step(memory.inner, plan[0], measurement), plan[1])

    def soft_step(self, memory: FrictionMemory, plan: Any, measurement: Any) -> Stepped | None:
        answer = self.controller.soft_step(memory.inner, plan[0], measurement)
        return None if answer is None else self._beside(answer, plan[1])

    def held(
        self, memory: FrictionMemory, measurement: Any, control: Float[np.ndarray, " p"]
    ) -> FrictionMemory:
        """Memory after the fallback: the wrapped controller repeats its own part."""
        own = control - memory.friction
        return memory._replace(inner=self.controller.held(memory.inner, measurement, own))

    def finished(self, memory: FrictionMemory) -> bool:
        return self.controller.finished(memory.inner)

    def _beside(self, answer: Stepped, friction: Float[np.ndarray, " p"]) -> Stepped:
        inner, own, report = answer
        control = np.clip(own + friction, -self._limit, self._limit)
        return FrictionMemory(inner, control - own), control, report


class LateMemory(NamedTuple):
    """Memory of the wrapped controller, and the control on its way to the machine."""

    inner: Any
    waiting: Float[np.ndarray, " p"]


class OneSampleLate(HostWrapper):
    """A controller whose u(k) acts from sample k+1 on.

    Args:
        controller: fed [x, u(k-1)], the state of a model with one sample of input delay.
        model: that model.
    """

    def __init__(self, controller: HostController, model: LinearPlant):
        super().__init__(controller)
        self.model = model

    def initial_memory(self, reference: Reference) -> LateMemory:
        """The control that holds the machine at the start on its way, as in `Delayed`.

        Raises:
            ValueError: as `LinearPlant.holding_control`, or what the wrapped controller raises.
        """
        held = np.asarray(self.model.holding_control(reference.position[0]))
        return LateMemory(self.controller.initial_memory(reference), held)

    def enter(self, memory: LateMemory, measurement: Any) -> np.ndarray:
        """The state, and the control that acts now."""
        return np.concatenate([measurement, memory.waiting])

    def leave(self, memory: LateMemory, fed: Any, inner: Any, control: Any):
        """The control found one sample ago acts, the one found now waits."""
        return LateMemory(inner, control), memory.waiting

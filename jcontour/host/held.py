"""A controller that is slower than the loop it runs in: it acts at every n-th sample and holds its control in between."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from jcontour.host.loop import HostController, StepReport
from jcontour.motion.references import Reference


class HeldMemory(NamedTuple):
    """Memory of the controller inside, its last control, and the samples since that began to act."""

    inner: Any
    control: Float[np.ndarray, " p"]
    age: int


class Held(HostController):
    """`controller`, made for the sample period n dt, in a loop of the sample period dt.

    It is given every n-th sample of the reference, so that machine and errors can be looked at
    between its samples.

    Args:
        controller: on the host.
        every: n.
        inputs: how many controls there are, p.

    Raises:
        ValueError: `every` is not a whole number of at least one.
    """

    def __init__(self, controller: HostController, every: int, inputs: int):
        if not (every == int(every) and every >= 1):
            raise ValueError(
                f"every: needs a whole number of samples of at least one, received {every}"
            )
        self.controller, self.every, self.inputs = controller, int(every), int(inputs)
        self.preview = controller.preview * self.every

    def prepare(self, reference: Reference) -> Any:
        """The plan of the controller inside, each row for n samples."""
        plan = self.controller.prepare(thinned(reference, self.every))
        return jax.tree.map(
            lambda rows: np.repeat(np.asarray(rows), self.every, axis=0)[: reference.steps], plan
        )

    def initial_memory(self, reference: Reference) -> HeldMemory:
        """That of the controller inside, which acts in the first sample."""
        return HeldMemory(
            self.controller.initial_memory(thinned(reference, self.every)), np.zeros(self.inputs), 0
        )

    def step(
        self, memory: HeldMemory, plan, measurement
    ) -> tuple[HeldMemory, Float[np.ndarray, " p"]]:
        """The controller's own step at every n-th sample, its last control otherwise."""
        inner, control = memory.inner, memory.control
        if memory.age == 0:
            inner, control = self.controller.step(inner, plan, measurement)
        return HeldMemory(inner, control, (memory.age + 1) % self.every), control

    def finished(self, memory: HeldMemory) -> bool:
        """Where the controller inside is, between its samples only."""
        return memory.age == 0 and self.controller.finished(memory.inner)

    def report(self) -> StepReport:
        """Of the step made last."""
        return self.controller.report()


def thinned(reference: Reference, every: int) -> Reference:
    """Every n-th sample of a reference, at n times its sample period; a last step that is cut off counts as a step."""
    steps = -(-reference.steps // every)
    samples = steps + reference.preview // every
    index = np.minimum(every * np.arange(samples), len(reference.position) - 1)
    rows = [
        np.asarray(values)[index]
        for values in (reference.position, reference.tangent, reference.arc, reference.mask)
    ]
    return Reference(
        *rows, reference.start_increment * every, reference.contour, reference.dt * every, steps
    )  # type: ignore

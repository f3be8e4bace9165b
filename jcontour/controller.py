"""The contract of a controller: a plan made from the future, a memory and a step."""

import abc
import warnings
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import is_concrete, whole_number
from jcontour.motion.references import Reference

Memory = Any  # any pytree of arrays
Plan = Any  # any pytree of arrays with a leading axis of T steps
Axes = Float[Array, " m"]
PerAxis = Float[Array, ""] | Float[Array, " m"]  # one number, or one for each axis
# laws that the contract tests hold every controller of the catalogue to
Law = Literal["same bits", "jit", "host", "vmap", "gradient", "rest", "restart", "shift"]


@runtime_checkable
class Sampled(Protocol):
    """A sampled controller, traceable (`Controller`) or on the host (`HostController`)."""

    @property
    def preview(self) -> int:
        """Samples of the future that it needs."""
        ...

    def prepare(self, reference: Reference) -> Plan:
        """Everything that depends on the future only."""

    def initial_memory(self, reference: Reference) -> Memory:
        """Memory before the first step."""


class Controller(eqx.Module):
    """A sampled controller that sees `preview` samples of the future.

    Attributes:
        laws_not_kept: why a law of the contract tests does not hold for the class.
    """

    laws_not_kept: ClassVar[Mapping[Law, str]] = {}
    preview: eqx.AbstractVar[int]

    @abc.abstractmethod
    def prepare(self, reference: Reference) -> Plan:
        """Everything that depends on the future only, for all T steps at once (leading axis T).

        Raises:
            ValueError: the reference has another sample period or number of axes, or looks less
                far ahead than the controller, here or in `initial_memory`.
        """

    @abc.abstractmethod
    def initial_memory(self, reference: Reference) -> Memory:
        """Memory before the first step of a run that starts as the reference says.

        A run that starts at rest starts in equilibrium: on a machine that stands on the first
        sample, the first control is `Plant.holding_control` there.
        """

    @abc.abstractmethod
    def step(
        self, memory: Memory, plan: Plan, measurement: Any
    ) -> tuple[Memory, Float[Array, " p"]]:
        """Next memory and the control, from one row of the plan and the present measurement."""

    def with_integrals_held(self, before: Memory, after: Memory, holds: Any) -> Memory:
        """Next memory, its integral parts those of before where a number is true."""
        return after

    def without_planned_limits(self) -> "Controller":
        """The controller where it is linear: it plans no limits and learns nothing."""
        return self


class Wrapper(Controller):
    """A controller around another one: it changes what goes into it or what comes out of it.

    It implements all of `Controller`, so that each wrapper states its one difference.
    """

    controller: eqx.AbstractVar[Controller]

    @property
    def preview(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Preview of the wrapped controller [samples]."""
        return self.controller.preview

    def prepare(self, reference: Reference) -> Plan:
        """Plan of the wrapped controller."""
        return self.controller.prepare(reference)

    def initial_memory(self, reference: Reference) -> Memory:
        """Memory of the wrapped controller."""
        return self.controller.initial_memory(reference)

    def step(
        self, memory: Memory, plan: Plan, measurement: Any
    ) -> tuple[Memory, Float[Array, " p"]]:
        """Step of the wrapped controller."""
        return self.controller.step(memory, plan, measurement)

    def with_integrals_held(self, before: Memory, after: Memory, holds: Any) -> Memory:
        """Memory of the wrapped controller."""
        return self.controller.with_integrals_held(before, after, holds)

    def without_planned_limits(self) -> Controller:
        """Wrapper around the controller without them."""
        free = self.controller.without_planned_limits()
        return eqx.tree_at(lambda one: one.controller, self, free)


def whole_preview(preview: float | int) -> int:
    """The preview as an int; ValueError unless it is a whole number of at least one sample."""
    return whole_number("preview", preview, 1)


def warn_of_short_preview(preview: int, delay: int) -> None:
    """Warn where a control acts on the position, `delay` samples on, past all that was seen."""
    if preview < delay:
        words = f"preview: {preview} samples are shorter than the plant's delay of {delay}"
        warnings.warn(f"{words}: a control acts past all that was seen", stacklevel=3)


def check_preview(controller: Sampled, reference: Reference) -> None:
    """Raise ValueError unless the reference looks as far ahead as the controller does."""
    if reference.preview < controller.preview:
        raise ValueError(
            f"preview: the controller looks {controller.preview} samples ahead, "
            f"the reference was made with {reference.preview}"
        )


def check_period(dt: float, reference: Reference) -> None:
    """Raise ValueError unless the reference has the controller's sample period `dt` [s]."""
    if reference.dt != dt:
        raise ValueError(
            f"dt: the controller is sampled every {dt} s, the reference every {reference.dt} s"
        )


def check_axes(axes: int, reference: Reference) -> None:
    """Raise ValueError unless the reference has as many axes as the controller reads."""
    received = reference.position.shape[-1]
    if received != axes:
        raise ValueError(f"sensors: the reference has {received} axes, the controller reads {axes}")


def checked_period(dt: float) -> float:
    """The sample period [s].

    Raises:
        ValueError: it is not finite or not above zero.
    """
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt: needs to be above zero, a period in seconds, received {dt}")
    return float(dt)


def numbers(value) -> Any:
    """Converter of a field: one number, or an array of them, as floats; none stays none."""
    return None if value is None else jnp.asarray(value, float)


def checked_gain(name: str, value) -> Array:
    """The gain as an array.

    Raises:
        ValueError: it is negative or not finite.
    """
    if is_concrete(value) and not np.all(np.isfinite(value) & (np.asarray(value) >= 0)):
        raise ValueError(f"{name}: needs to be finite and at least zero, received {value}")
    return numbers(value)


def check_limit(limit) -> None:
    """Raise ValueError unless the limits of the control are above zero.

    They are the same in both directions; traced values pass unchecked.
    """
    if is_concrete(limit) and not np.all(np.asarray(limit) > 0):
        raise ValueError(f"limit: needs to be above zero, received {limit}")

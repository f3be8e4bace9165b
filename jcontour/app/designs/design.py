"""Controllers as the commands see them: named weights, their ranges, what they build.

A design also stores the files of a tuned controller.
"""

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self

import jax.numpy as jnp
import numpy as np

from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.plain_numbers import named_numbers
from jcontour.controller import Controller
from tuning.parameters import Fixed, Interval, Parameter, Weights

if TYPE_CHECKING:  # the solvers take a second to import
    from jcontour.host.controller import HostController
    from jcontour.mpc.tracking.limits import Limits
    from jcontour.qp.solvers import Solver


@dataclass(frozen=True)
class Design(abc.ABC):
    """A controller for one machine, its numbers open.

    Attributes:
        name: that of the catalogue.
        machine: what it is for.
        start: first weights by name, a dict or a module.
        space: one parameter for each, see `tuning.parameters`.
        preview: samples of the future it needs.
        fed: what it is fed, the sensors or the whole state.
        learns: it changes while it runs; its margins are those of the loop that it begins with.
    """

    name: str
    machine: Machine
    start: Weights
    space: Any
    preview: int
    fed: Fed
    learns: bool = field(default=False, kw_only=True)

    limitable = False  # whether `constrained` has an answer
    # whether the controller itself keeps to the machine's limits: the search then need not
    keeps_limits: ClassVar[bool] = False
    # samples that a tuned tool may be behind, where no flag limits it: a loop of 20 1/s at 1 ms
    lag: ClassVar[float] = 50.0
    # names that stand for several weights
    groups: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})

    @abc.abstractmethod
    def build(self, weights: Weights) -> Controller:
        """The controller; traced, so that gradients flow through it."""

    def freed(self, names: Sequence[str]) -> Self:
        """The same with these weights free and all others fixed; a group stands for its weights.

        Raises:
            ValueError: there is no such weight or group.
        """
        space = by_name(self.space)
        known = [name for name, parameter in space.items() if parameter is not None]
        wanted = [name for group in names for name in self.groups.get(group, (group,))]
        for name in wanted:
            if name not in known:
                named = ", ".join([*known, *self.groups])
                raise ValueError(f"free: there is no weight {name!r}; known are {named}")
        fixed = {
            name: parameter if parameter is None or name in wanted else Fixed()
            for name, parameter in space.items()
        }
        kept = fixed if isinstance(self.space, dict) else type(self.space)(**fixed)
        return replace(self, space=kept)

    def tunable(self) -> "Design":
        """The design that is tuned: itself where it does not say otherwise."""
        return self

    def constrained(
        self, weights: Weights, limits: "Limits", solver: "Solver"
    ) -> "HostController | None":
        """The controller with these weights under limits at every sample; None where there is none.

        Raises:
            ValueError: the limits do not fit the machine.
        """
        return None

    @property
    def costs(self) -> frozenset[str]:
        """Names of weights of a quadratic cost.

        The speed of a loop grows with their roots: they vary over more decades than gains.
        """
        return frozenset()

    @abc.abstractmethod
    def units(self) -> dict[str, str]:
        """Unit of every weight that is one number, or one for each axis."""

    @abc.abstractmethod
    def settings(self) -> dict[str, Any]:
        """Settings that are chosen and not tuned, for the stored result."""

    @abc.abstractmethod
    def description(self) -> dict[str, str]:
        """Description heading by heading, for people."""

    @abc.abstractmethod
    def weight_lines(self, weights: dict[str, Any]) -> list[str]:
        """Named weights with their units, one line each, as an engineer types them into a drive."""

    @property
    @abc.abstractmethod
    def files(self) -> dict[str, str]:
        """Files that `save` writes, and how a drive reads each, in a few words."""

    @abc.abstractmethod
    def save(self, controller: Controller, scenarios: Scenarios, folder: Path) -> None:
        """Files of a tuned controller beside its weights."""

    def free(self) -> list[str]:
        """Names of the weights that are tuned."""
        space, kept = by_name(self.space), (Fixed, type(None))
        return [name for name in by_name(self.start) if not isinstance(space.get(name), kept)]

    def check_start(self) -> None:
        """Raise ValueError unless every weight that is tuned starts where it may go."""
        if not self.free():
            raise ValueError(f"controller: {self.name} has no free weights, nothing is tuned of it")
        for name in self.free():
            parameter, weight = by_name(self.space)[name], by_name(self.start)[name]
            if not parameter.allows(np.asarray(weight)):
                raise ValueError(
                    f"{name}: tuning needs a start {_place(parameter)}, received {weight}"
                )


def by_name(weights: Weights) -> dict[str, Any]:
    """The weights, a dict, a module or a NamedTuple, as a dict."""
    if isinstance(weights, dict):
        return dict(weights)
    fields = getattr(weights, "_asdict", lambda: vars(weights))
    return dict(fields())


def _place(parameter: Parameter) -> str:
    if isinstance(parameter, Interval):
        return f"between {parameter.low:g} and {parameter.high:g}"
    return "above zero"


def plain_weights(weights: Weights) -> dict[str, Any]:
    """Named weights as floats, and lists where there are several; None where there is none."""
    return {
        name: None if value is None else np.asarray(value, float).tolist()
        for name, value in by_name(weights).items()
    }


def changed(start: Weights, changes: Sequence[str]) -> Weights:
    """The start with some weights given as NAME=VALUE, or NAME=VALUE,VALUE,... for several axes.

    Raises:
        ValueError: there is no such weight, its value is not a finite number, or there are more or
            fewer numbers than it has.
    """
    named = by_name(start)
    values = {}
    for change in changes:
        name, numbers = named_numbers("weights", change)
        if name not in named:
            raise ValueError(f"weights: there is no weight {name!r}; known are {', '.join(named)}")
        size = np.size(named[name])
        if len(numbers) not in (1, size):
            needed = "one number" if size == 1 else f"one number or {size}"
            raise ValueError(f"weights: {name} needs {needed}, received {change!r}")
        first, *more = numbers
        values[name] = numbers if more else first
    return with_values(start, values)


def with_values(weights: Weights, values: dict[str, Any]) -> Weights:
    """The weights with some of them replaced by name; one number stands for all axes."""
    named = by_name(weights)
    named = named | {
        name: jnp.broadcast_to(jnp.asarray(value), np.shape(named[name]))
        for name, value in values.items()
    }
    return named if isinstance(weights, dict) else type(weights)(**named)

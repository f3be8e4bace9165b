"""Controllers as the commands see them: a class for each, with its weights and what it builds.

A class describes itself: its first line says what it is, `needs` which machines it is for,
`weights` its weights with units and ranges, `build` makes the controller of them. The catalogue
lists it by its name.
"""

import abc
import inspect
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.files import run_folder
from jcontour.app.flags.shared import Controlled
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.plain_numbers import named_numbers
from jcontour.controller import Controller
from jcontour.linear.plant import LinearPlant
from tuning.parameters import Fixed, Interval, Parameter, Positive, Weight, Weights

if TYPE_CHECKING:  # the solvers take a second to import
    from jcontour.host.controller import HostController
    from jcontour.mpc.tracking.limits import Limits
    from jcontour.qp.solvers import Solver

SETTINGS = ("preview", "terminal", "model_delay")  # flags that not every class reads
M = TypeVar("M", bound=Machine)
D = TypeVar("D", bound="Design")
Gains = dict[str, Any]  # name -> number, or one for each axis


class Needs(NamedTuple):
    """Machines that a controller is for."""

    words: str  # what they are
    kind: str = ""  # as `Machine.kind` says it; any where empty
    also: Callable[[Any], bool] = lambda _: True  # what such a machine has to fulfil besides

    def met_by(self, machine: Machine) -> bool:
        """Whether the controller suits this machine."""
        return self.kind in ("", machine.kind) and self.also(machine)


class Design(abc.ABC, Generic[M]):
    """A controller for one machine, its weights open.

    Args:
        name: that of the catalogue.
        machine: that it is for.
        flags: preview, first weights and what else the class reads.

    Attributes:
        line: description in one line, the first one of the class.
        needs: machines that it is for.
        weights: description of each of its weights.
        reads: flags that it takes, of `SETTINGS`.
        fed: measured by the sensors, or the whole state.
        learns: it changes while it runs; its margins are those of the loop that it begins with.
        limitable: `constrained` has an answer.
        keeps_limits: it keeps to the machine's limits by itself: the search then need not.
        lag: samples that a tuned tool may be behind, where no flag limits it: of a loop of 20 1/s
            at 1 ms.
        groups: names that stand for several weights.
        first: its weights by name, with start and range on this machine.
        start, space: first value and range of every weight by name.
        preview: samples of the future that it needs.
        compensation: wrappers that compensate what the machine is known to have, inner ones first.
        beside: a line for each of them that a drive has to have beside the weights.
    """

    line: str = ""
    needs: ClassVar[Needs]
    weights: tuple[Weight, ...] = ()
    reads: tuple[str, ...] = ()
    fed: Fed = "outputs"
    learns: ClassVar[bool] = False
    limitable: ClassVar[bool] = False
    keeps_limits: ClassVar[bool] = False
    lag: ClassVar[float] = 50.0
    groups: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})
    compensation: tuple[Callable[[Controller], Controller], ...] = ()
    beside: tuple[str, ...] = ()

    def __init__(self, name: str, machine: M, flags: Controlled):
        self.name, self.machine, self.flags = name, machine, flags
        self.line = self.line or first_line(type(self))
        begun, self.first = self.starts(), {}
        for one in self.weights:  # those that the machine has
            start = begun.get(one.name, one.start)
            start = start(machine) if callable(start) else start
            if start is not None:
                within = one.range if isinstance(one.range, Parameter) else one.range(machine)
                unit = one.unit.format(control=machine.control_unit)
                self.first[one.name] = one._replace(unit=unit, range=within, start=start)
        starts = {name: one.start for name, one in self.first.items()}
        self.start: Gains = changed(starts, given(flags))
        self.space: dict[str, Any] = {name: one.range for name, one in self.first.items()}
        self.preview = self.first_preview(starts)

    @abc.abstractmethod
    def build(self, weights: Weights) -> Controller:
        """The controller; traced, so that gradients flow through it."""

    def complete(self, weights: Weights) -> Controller:
        """The controller as it runs: around it what compensates dry friction and backlash."""
        controller = self.build(weights)
        for around in self.compensation:
            controller = around(controller)
        return controller

    def starts(self) -> Gains:
        """Where weights begin that do not say it; the machine has no weight without a start."""
        return {}

    def first_preview(self, first: Weights) -> int:
        """Samples of the future that the controller needs with its own first weights."""
        return self.build(first).preview

    def state_cost(self, model: LinearPlant, weights: Weights) -> Float[Array, "n n"]:
        """Weight Q on the state in the cost that the weights give a law of the model's state."""
        return (weights["alpha"] + weights["beta"]) * model.C.T @ model.C

    def replaced(self: D, **attributes: Any) -> D:
        """The same with other attributes."""
        other = copy(self)
        vars(other).update(attributes)
        return other

    def freed(self: D, names: Sequence[str]) -> D:
        """The same with these weights free and all others fixed; a group stands for its weights."""
        known = list(self.space)
        wanted = [name for group in names for name in self.groups.get(group, (group,))]
        for name in wanted:
            if name not in known:
                named = ", ".join([*known, *self.groups])
                raise ValueError(f"free: there is no weight {name!r}; known are {named}")
        space = {name: one if name in wanted else Fixed() for name, one in self.space.items()}
        return self.replaced(space=space)

    def tunable(self: D) -> D:
        """The design that is tuned: itself where it does not say otherwise."""
        return self

    def constrained(
        self, weights: Weights, limits: "Limits", solver: "Solver"
    ) -> "HostController | None":
        """The controller with these weights under limits at every sample; None if there is none."""
        return None

    @property
    def costs(self) -> frozenset[str]:
        """Names of weights of a quadratic cost.

        The speed of a loop grows with their roots: they vary over more decades than gains.
        """
        return frozenset(name for name, one in self.first.items() if one.cost)

    def units(self) -> dict[str, str]:
        """Unit of every weight that is one number, or one for each axis."""
        return {name: one.unit for name, one in self.first.items()}

    def settings(self) -> dict[str, Any]:
        """Settings that are chosen and not tuned, for the stored result."""
        return {"preview": self.preview}

    def description(self) -> dict[str, str]:
        """Description heading by heading, for people."""
        start = ", ".join(f"{name} {_words(self.start[name])}" for name in self.free())
        return {"Controller": self.line, "Free": f"start {start}"}

    def weight_lines(self, weights: dict[str, Any]) -> list[str]:
        """Named weights with their units, one line each, as an engineer types them into a drive."""
        width = max(map(len, weights))
        return [
            f"{name:<{width}}  {_words(value)} {self.first[name].unit}".rstrip()
            for name, value in weights.items()
        ]

    def lines(self, weights: dict[str, Any]) -> list[str]:
        """Weights, and what stands beside them, one line each."""
        return [*self.weight_lines(weights), *self.beside]

    @property
    def files(self) -> dict[str, str]:
        """Files that `save` writes, and how a drive reads each, in a few words."""
        return {"controller.json": "every number of the controller by its place, SI units"}

    def save(self, controller: Controller, scenarios: Scenarios, folder: Path) -> None:
        """Files of a tuned controller beside its weights: its numbers, by their place in it."""
        leaves = jax.tree_util.tree_leaves_with_path(eqx.filter(controller, eqx.is_inexact_array))
        numbers = {
            jax.tree_util.keystr(path).lstrip("."): np.asarray(leaf).tolist()
            for path, leaf in leaves
        }
        run_folder.write_json(
            folder / "controller.json",
            {"dt": self.machine.model.dt, "controller": self.line, "numbers": numbers},
        )

    def free(self) -> list[str]:
        """Names of the weights that are tuned."""
        return [name for name in self.start if not isinstance(self.space[name], Fixed)]

    def check_start(self) -> None:
        """Raise ValueError unless every weight that is tuned starts where it may go."""
        if not self.free():
            raise ValueError(f"controller: {self.name} has no free weights, nothing is tuned of it")
        for name in self.free():
            parameter, weight = self.space[name], self.start[name]
            if not parameter.allows(np.asarray(weight)):
                raise ValueError(
                    f"{name}: tuning needs a start {_place(parameter)}, received {weight}"
                )

    def model_delay(self, most: int, usual: int) -> int:
        """Samples of the unknown delay that the model predicts over; the usual if not given."""
        asked = self.flags.model_delay
        if asked is not None and not 0 <= asked <= most:
            raise ValueError(
                f"model-delay: {self.machine.name} may be 0 to {most} samples late beyond what is "
                f"known, received {asked}"
            )
        return usual if asked is None else asked


class Drift(Positive):
    """Drift that an observer takes, at most a thousand times more or less than at the start.

    That is a factor of ten in the bandwidth of what finds the load. Where a family has no load to
    find, tuning would buy margin by looking for none, until the load is no longer observed.
    """

    reach: ClassVar[float] = float(np.log(1e3))


class LinearDesign(Design[LinearMachine]):
    """A controller of a machine given by A, B, C."""

    needs = Needs("a machine given by A, B, C", "linear")

    @cached_property
    def late(self) -> int:
        """Samples of the unknown delay in the nominal machine: the middle where not given."""
        return self.model_delay(self.machine.unknown_delay, self.machine.middle_delay)


def first_line(described: Any) -> str:
    """First line of the docstring of a class, without its full stop."""
    return (described.__doc__ or "").partition("\n")[0].rstrip(".")


def picked(names: str, gains: Gains) -> list[Any]:
    """The gains of these names, separated by blanks, in their order."""
    return [gains[name] for name in names.split()]


def _place(parameter: Parameter) -> str:
    if isinstance(parameter, Interval):
        return f"between {parameter.low:g} and {parameter.high:g}"
    return "above zero"


def _words(value: Any) -> str:
    numbers = [value] if isinstance(value, float) else np.ravel(value)
    return ", ".join(f"{float(number):.6g}" for number in numbers)


def plain_weights(weights: Weights) -> dict[str, Any]:
    """Named weights as floats, and lists where there are several."""
    return {name: np.asarray(value, float).tolist() for name, value in weights.items()}


def given(flags: Controlled) -> list[str]:
    """Weights that the flags set, as NAME=VALUE; those of --weights come last and hold."""
    named = {name: getattr(flags, name) for name in ("alpha", "beta", "rho")}
    own = [f"{name}={value!r}" for name, value in named.items() if value is not None]
    return [*own, *flags.weights]


def changed(start: Gains, changes: Sequence[str]) -> Gains:
    """The start with some weights given as NAME=VALUE, or NAME=VALUE,VALUE,... for several axes."""
    values = {}
    for change in changes:
        name, numbers = named_numbers("weights", change)
        if name not in start:
            raise ValueError(f"weights: there is no weight {name!r}; known are {', '.join(start)}")
        size = np.size(start[name])
        if len(numbers) not in (1, size):
            needed = "one number" if size == 1 else f"one number or {size}"
            raise ValueError(f"weights: {name} needs {needed}, received {change!r}")
        first, *more = numbers
        values[name] = numbers if more else first
    return with_values(start, values)


def with_values(weights: Gains, values: dict[str, Any]) -> Gains:
    """The weights with some of them replaced by name; one number stands for all axes."""
    return weights | {
        name: jnp.broadcast_to(jnp.asarray(value), np.shape(weights[name]))
        for name, value in values.items()
    }


def made(thing: Any, model: LinearPlant, preview: int) -> Any:
    """Controller of a class, with `for_model` or without arguments, or of a function of the model.

    Both may take the preview as well.
    """
    make = getattr(thing, "for_model", thing)
    if make is thing and inspect.isclass(thing):
        return thing()
    takes = inspect.signature(make).parameters
    return make(model, preview=preview) if "preview" in takes else make(model)


class OwnDesign(Design[Machine]):
    """A controller that somebody has made for a machine."""

    needs = Needs("a machine that it is made for")

    def __init__(
        self, name: str, line: str, controller: Controller, machine: Machine, flags: Controlled
    ):
        self.line, self.controller = line, controller
        self.reads = ("preview",) if controller.preview == flags.horizon(machine.model.dt) else ()
        values = _fields(controller)
        said = {one.name: one for one in getattr(controller, "weights", ())}
        unknown = [field for field in said if field not in values]
        if unknown:
            raise ValueError(
                f"{name}: weights: there is no weight {unknown[0]!r}; known are {', '.join(values)}"
            )
        self.weights = tuple(
            said.get(field, Weight(field))._replace(start=value) for field, value in values.items()
        )
        super().__init__(name, machine, flags)

    def build(self, weights: Gains) -> Controller:
        names = list(weights)
        if not names:
            return self.controller
        values = [weights[name] for name in names]
        return eqx.tree_at(
            lambda one: [getattr(one, name) for name in names], self.controller, values
        )

    def first_preview(self, first: Gains) -> int:
        return self.controller.preview


def _fields(controller: Controller) -> Gains:
    """Its fields that are finite floats, one or several in a row."""
    fields = {}
    for name, field in type(controller).__dataclass_fields__.items():
        value = getattr(controller, name)
        if field.metadata.get("static") or not eqx.is_inexact_array_like(value):
            continue
        if np.ndim(value) <= 1 and np.all(np.isfinite(value)):  # a limit may be infinite
            fields[name] = value
    return fields

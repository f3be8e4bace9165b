"""Machines as the commands see them.

A machine has a model that controllers may know, and a family of plants that it may really be.
"""

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Protocol

import jax
import numpy as np
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant
from jcontour.plant import Plant
from jcontour.simulation.evaluation import stack_plants
from jcontour.simulation.limit_use import hidden_acceleration

if TYPE_CHECKING:
    from jcontour.analysis.uncertain_loops import Lines, ResponseUncertainty

Fed = Literal["outputs", "state"]  # the controller is fed the machine's sensors, or the state
NO_EFFECTS = "no further effects"  # of a machine whose true family is the smooth one


class MachineLimits(NamedTuple):
    """Greatest magnitudes per axis (m,), SI and control units; None where not given."""

    speed: np.ndarray | None = None
    acceleration: np.ndarray | None = None
    control: np.ndarray | None = None
    increment: np.ndarray | None = None
    jerk: np.ndarray | None = None


class Usual(NamedTuple):
    """Defaults of the commands on a kind of machine."""

    controller: str  # its name in the catalogue
    training: tuple[str, ...]  # what is tuned on
    held_out: tuple[str, ...]  # what the tuner never sees
    beside_own: tuple[str, ...]  # held out beside parts of the user's own
    # simulated, front, swept: what these commands run
    simulated: str
    front: tuple[str, ...]
    swept: tuple[str, ...]
    # greatest RMS control of tuned weights where it is not limited, in multiples of what the start
    # needs; None for any
    effort: float | None = None


class Hosted(NamedTuple):
    """A machine as a controller on the host meets it."""

    plant: Plant  # as it is, its whole state measured
    model: LinearPlant  # at the controller's sample period
    every: int  # samples of the plant in one of these


class Member(Protocol):
    """A plant of the family, by what it differs in."""

    @property
    def name(self) -> str:
        """For tables."""
        ...


@dataclass(frozen=True)
class Machine(abc.ABC):
    """A machine as the commands see it; SI units."""

    name: str  # for tables
    model: LinearPlant  # what a controller may know: linear, a known delay included
    axes: tuple[str, ...]  # names, one per output
    control_unit: str  # text for tables and figures
    limits: MachineLimits  # greatest magnitudes
    kind: ClassVar[str] = ""  # as `Needs` of controllers name it
    # `module:class` of its LQ controller behind an observer that finds the load, and of its cascade
    # with feedforward: laws for any machine stand on them; empty without one
    observed: ClassVar[str] = ""
    cascade: ClassVar[str] = ""

    @property
    def shares(self) -> np.ndarray:
        """(p, m) D of the drives' controls u = D v, where a law has as many as there are axes."""
        return np.eye(self.model.inputs)

    @property
    def linear(self) -> Any:
        """The machine as a `LinearMachine`, one given by A, B, C; None where it is none."""
        return None

    @property
    @abc.abstractmethod
    def nonsmooth_effects(self) -> str:
        """Effects that the true family has and the smooth one has not, in a few words."""

    @property
    def error(self) -> Literal["contour", "tracking"]:
        """Error that counts: "contour" along a path, "tracking" on a single axis."""
        return "contour" if len(self.axes) > 1 else "tracking"

    @property
    def remarks(self) -> list[str]:
        """What its file wants to be said where it is run."""
        return []

    @property
    def resolution(self) -> float | np.ndarray | None:
        """Length of a count of the encoders [m], one number or one for each axis (m,).

        None where nothing is counted.
        """
        return None

    @property
    def noisy_count(self) -> float | np.ndarray | None:
        """Length of a count whose rounding alone is as noisy as the encoders [m], as `resolution`.

        That itself where nothing but their counts is known.
        """
        return self.resolution

    @property
    def sensed(self) -> tuple[str, ...]:
        """Units of what the sensors give, in their order; empty where only the plant knows."""
        return ()

    @property
    def response_uncertainty(self) -> "ResponseUncertainty | None":
        """How far off the response may be, beside the family; None where nothing is said."""
        return None

    @property
    def measured(self) -> "tuple[Lines, ...]":
        """What was measured of the response behind each control; empty where nothing was."""
        return ()

    @property
    def hidden_acceleration(self) -> np.ndarray:
        """(m, p) acceleration between samples per unit of a control that alternates, see there."""
        return hidden_acceleration(self.model)

    @property
    @abc.abstractmethod
    def usual(self) -> Usual:
        """Defaults of the commands on this machine."""

    @property
    @abc.abstractmethod
    def members(self) -> Sequence[Member]:
        """Every plant of the family, the nominal one first."""

    @abc.abstractmethod
    def drawn(self, count: int, seed: int) -> Sequence[Member]:
        """Members drawn evenly from the family's intervals, then their corners; none of one plant.

        A delay has parts of a sample.
        """

    @property
    def family_names(self) -> list[str]:
        """Names of the members."""
        return [one.name for one in self.members]

    @property
    @abc.abstractmethod
    def unknown_delay(self) -> int:
        """Most samples by which a control is late in the family and not in the model."""

    @abc.abstractmethod
    def smooth_family(self, fed: Fed = "outputs") -> Sequence[Plant]:
        """Every plant of the family, all of one structure, with derivatives: what is tuned on."""

    @abc.abstractmethod
    def true_plant(self, member: Any, fed: Fed = "outputs") -> Plant:
        """A member with what has no derivative, behind its sensors."""

    def true_family(self, fed: Fed = "outputs") -> Sequence[Plant]:
        """The members with what has no derivative: what is confirmed on."""
        return [self.true_plant(member, fed) for member in self.members]

    def random_family(self, count: int, seed: int, fed: Fed = "outputs") -> Plant | None:
        """The drawn members, stacked; None where the family is a single plant."""
        drawn = [self.true_plant(member, fed) for member in self.drawn(count, seed)]
        return stack_plants(drawn) if drawn else None

    def hosted(self) -> Hosted:
        """Plant and model for a controller on the host: the model itself."""
        return Hosted(self.model, self.model, 1)

    @property
    def frictionless(self) -> "Machine":
        """The same without the dry friction of its file; itself where friction is part of it."""
        return self

    def positions(self, fed: Fed) -> Callable[[Any], Float[Array, " m"]]:
        """Positions of the axes in a measurement: of the tool, or of the motors that measure it."""
        raise self._no_linear_models()

    def linear_family(self, fed: Fed, path: Float[Array, "T m"]) -> Sequence[Plant]:
        """Every plant of the family, linear along this path [m]: no friction, counts, limits."""
        raise self._no_linear_models()

    def linear_nominal(self, fed: Fed, path: Float[Array, "T m"]) -> Plant:
        """Linear nominal plant along this path [m]."""
        return self.nominal(fed)

    def noisy_nominal(self, key: jax.Array, fed: Fed, path: Float[Array, "T m"]) -> Plant:
        """The same behind encoders with noise, uniform within half a count, in place of counts."""
        raise self._no_linear_models()

    def with_noise(self, plant: Plant, key: jax.Array, steps: int, fed: Fed) -> Plant:
        """A plant of the true family with other noise of its encoders, where they have some."""
        return plant

    def _no_linear_models(self) -> ValueError:
        return ValueError(
            "plant: needs a machine given by A, B, C, flexible axes or a gantry, "
            f"{self.name} is none of them"
        )

    @abc.abstractmethod
    def nominal(self, fed: Fed = "outputs") -> Plant:
        """Smooth nominal plant behind its sensors: margins are computed on it."""

    @abc.abstractmethod
    def description(self) -> dict[str, str]:
        """Description heading by heading, for people."""

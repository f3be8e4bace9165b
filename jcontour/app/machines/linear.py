"""Machines with a linear model, positions measured by encoders.

Their families differ in input gains and delays. Those of the catalogue are tables of two papers,
and a public benchmark.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.machines.families import GainsAndDelayMachine
from jcontour.app.machines.machine import Fed, Hosted, MachineLimits, Usual
from jcontour.app.machines.uncertainty import (
    FARTHEST,
    FRICTION_KNOWN_TO,
    Uncertainty,
    in_words,
    rounding_noise,
    sensor_noise,
)
from jcontour.linear.plant import steady_motion
from jcontour.plant import Plant
from jcontour.plants.actuation import Backlash, Disturbed, with_dry_friction
from jcontour.plants.encoders import Encoders, Quantised
from jcontour.plants.friction import with_dry_friction_times
from jcontour.plants.linear_machines import ENCODER_RESOLUTION, exact_bridgeport
from jcontour.simulation.limit_use import hidden_acceleration

if TYPE_CHECKING:
    from jcontour.analysis.uncertain_loops import Lines

USUAL = Usual(
    "contouring-lq",
    training=("cam", "circle", "square"),
    # the bracket's length would triple the minute that training takes
    held_out=("bracket", "ellipse", "lemniscate"),
    beside_own=("circle", "ellipse", "lemniscate"),  # quick ones
    simulated="circle",
    front=("square",),
    swept=("circle", "square"),
)


@dataclass(frozen=True)
class LinearMachine(GainsAndDelayMachine):
    """A linear machine; lengths in metres."""

    kind: ClassVar[str] = "linear"
    observed: ClassVar[str] = "jcontour.app.designs.receding_horizon:RiccatiLQ"
    cascade: ClassVar[str] = "jcontour.app.designs.simple_loops:ProportionalIntegralLoop"

    known_delay: int  # samples of it in the model
    encoder_resolution: float | np.ndarray  # [m] per count, of all axes or of each (m,)
    control_noise: float  # standard deviation that the Kalman filter assumes on each control
    # standard deviation of the encoders beside their rounding [m], of all axes or of each (m,)
    encoder_noise: float | np.ndarray = 0.0
    # weights of its publication by name; None where nothing is published
    published: Mapping[str, float] | None = None
    # the machine that a controller meets on the host, where that is another than the model
    with_friction: Callable[[], Hosted] | None = None
    contours: Usual = USUAL  # what the commands run on it
    # control that dry friction takes, of all axes or of each (m,): in the runs, not in linear
    # loops; None where it is not known, and nowhere
    friction: float | np.ndarray | None = 0.0
    friction_known_to: float | np.ndarray = FRICTION_KNOWN_TO  # relative, of all or of each (m,)
    # what it is more at rest, and the speed at which half of that is left [m/s], likewise
    stribeck: tuple[float | np.ndarray, float | np.ndarray] = (0.0, 1.0)
    # gap between the motor, which is measured, and the tool [m], of all axes or of each (m,): in
    # the runs, not in linear loops
    backlash: float | np.ndarray = 0.0
    note: str = ""  # of its file, to be repeated where it is run; empty without one

    @property
    def linear(self) -> "LinearMachine":
        return self

    @property
    def measured(self) -> "tuple[Lines, ...]":
        return () if self.uncertainty.response is None else self.uncertainty.response.lines

    @property
    def remarks(self) -> list[str]:
        return [*([f"{self.name}: {self.note}"] if self.note else []), *super().remarks]

    @property
    def nonsmooth_effects(self) -> str:
        encoders = "quantised, noisy encoders" if self.noisy else "quantised encoders"
        loose = " and backlash" if np.any(self.backlash) else ""
        return encoders + (" and dry friction" if self.largest_friction else "") + loose

    @property
    def resolution(self) -> float | np.ndarray:
        return self.encoder_resolution

    @property
    def noisy_count(self) -> float | np.ndarray:
        """Rounding has a variance of a twelfth of its square."""
        if not self.noisy:
            return self.encoder_resolution
        return np.sqrt(self.encoder_resolution**2 + 12 * self.encoder_noise**2)

    @property
    def largest_friction(self) -> float:
        """Of all axes, at rest; 0 where it is not known."""
        return 0.0 if self.friction is None else float(np.max(self.friction + self.stribeck[0]))

    @property
    def noisy(self) -> bool:
        """Whether the encoders have noise beside their rounding."""
        return bool(np.any(self.encoder_noise))

    @property
    def hidden_acceleration(self) -> np.ndarray:
        """Of the model; its known delay has none."""
        return hidden_acceleration(self.model, self.known_delay)

    @property
    def sensed(self) -> tuple[str, ...]:
        return ("m",) * len(self.axes)

    @property
    def usual(self) -> Usual:
        return self.contours

    @property
    def middle_delay(self) -> int:
        """Middle of the delay that the model does not know, rounded down [samples]."""
        return self.unknown_delay // 2

    @property
    def largest_control(self) -> float:
        """Smallest of the controls' limits; 1 where none is stated."""
        return 1.0 if self.limits.control is None else float(np.min(self.limits.control))

    @cached_property
    def holding(self) -> np.ndarray:
        """Control per m that holds each axis at rest; zero where drives take a speed or a force."""
        with jax.ensure_compile_time_eval():
            return np.asarray(self.model.holding_control(jnp.ones(self.model.axes)))

    @property
    def frictionless(self) -> "LinearMachine":
        """The same without dry friction: its loops are linear."""
        return replace(self, friction=0.0, stribeck=(0.0, 1.0), backlash=0.0)

    def smooth_family(self, fed: Fed = "outputs") -> Sequence[Plant]:
        """The members behind encoders with noise in place of counts, or their state measured.

        Without the noise a loop that amplifies it would pass for a good one.
        """
        members = [self.member(one) for one in self.members]
        if fed == "state":
            return members
        noise = rounding_noise(self.model.axes, self.noisy_count)
        return [Disturbed(Encoders(plant), noise=noise) for plant in members]

    def positions(self, fed: Fed) -> Callable[[Any], Float[Array, " m"]]:
        return self.model.output if fed == "state" else lambda measurement: measurement

    def linear_family(self, fed: Fed, path: Float[Array, "T m"]) -> Sequence[Plant]:
        return self.exact_family(fed)

    def noisy_nominal(self, key: jax.Array, fed: Fed, path: Float[Array, "T m"]) -> Plant:
        """The model behind encoders with noise in place of counts; a state is measured as it is."""
        if fed == "state":
            return self.model
        half = self.noisy_count / 2
        noise = jax.random.uniform(key, path.shape, minval=-half, maxval=half)
        return Disturbed(Encoders(self.model), noise=noise)

    def with_noise(self, plant: Plant, key: jax.Array, steps: int, fed: Fed) -> Plant:
        """Gaussian noise within three deviations, alike on all plants. Counts are no noise."""
        if not self.noisy or fed == "state":
            return plant
        if isinstance(plant, Backlash):
            return replace(plant, plant=self.with_noise(plant.plant, key, steps, fed))
        deviation = jnp.broadcast_to(jnp.asarray(self.encoder_noise), (1, self.model.axes))
        drawn = jax.random.normal(key, (steps, self.model.axes))
        noise = deviation * jnp.clip(drawn, -FARTHEST, FARTHEST)
        return eqx.tree_at(lambda counted: counted.plant.noise, plant, noise)

    def exact_family(self, fed: Fed = "outputs") -> Sequence[Plant]:
        """The members without friction, behind encoders that do not round, or their state."""
        plants = [self.frictionless.member(one) for one in self.members]
        return plants if fed == "state" else [Encoders(plant) for plant in plants]

    def counted(self, plant: Plant, fed: Fed = "outputs") -> Plant:
        """A plant behind the encoders, with noise and whole counts, or its state measured.

        Its tool is behind the backlash.
        """
        if fed != "state":
            plant = Encoders(plant)
            if self.noisy:
                plant = Disturbed(plant, noise=sensor_noise(self.model.axes, self.encoder_noise))
            plant = Quantised(plant, resolution=self.encoder_resolution)
        return Backlash(plant, jnp.asarray(self.gaps)) if np.any(self.backlash) else plant

    @property
    def gaps(self) -> np.ndarray:
        """Backlash of every axis [m]."""
        return np.broadcast_to(np.asarray(self.backlash, float), self.model.axes)

    @cached_property
    def mechanics(self) -> Plant:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The model with friction; where drives take positions no wait of a control delays it."""
        if self.friction is None or not self.largest_friction:
            return self.model
        A, C = np.asarray(self.model.A), np.asarray(self.model.C)
        entry = np.array(self.model.B)
        for k, row in enumerate(C):  # where the control of an axis waits, past the wait
            for _ in range(len(A)):
                entry[:, k] = entry[:, k] if row @ entry[:, k] else A @ entry[:, k]
        with jax.ensure_compile_time_eval():  # not in the programs of families: batches of factors
            motion = steady_motion(self.model)  # may wait for each other's threads there
        model = eqx.tree_at(lambda m: m.motion, self.model, motion, is_leaf=lambda m: m is None)
        coulomb = np.broadcast_to(self.friction, self.model.axes)
        return with_dry_friction(model, entry, coulomb, self.stribeck)

    def rubbed(self, gains: np.ndarray) -> Plant:
        """With the more friction the smaller the gains are, so that both add up."""
        known = self.uncertainty.gain
        if not (known and self.largest_friction):
            return self.mechanics
        factor = jnp.asarray(1 - self.friction_known_to * (gains - 1) / known)
        return with_dry_friction_times(self.mechanics, factor)

    def hosted(self) -> Hosted:
        return super().hosted() if self.with_friction is None else self.with_friction()

    def nominal(self, fed: Fed = "outputs") -> Plant:
        return self.model if fed == "state" else Encoders(self.model)

    def description(self) -> dict[str, str]:
        states = f"{self.model.states} states (known delay {self.known_delay})"
        time = f"dt {1e3 * self.model.dt:g} ms"
        sensors = f"positions only, encoder {in_words(self.encoder_resolution)}"
        if self.noisy:
            sensors += f", noise {in_words(self.encoder_noise)}"
        friction = "not known, neither in the runs nor in what is proven"
        if self.friction is not None:
            each = " ".join(f"{one:.3g}" for one in np.atleast_1d(self.friction))
            if np.any(self.stribeck[0]):
                more = " ".join(f"{one:.3g}" for one in np.atleast_1d(self.stribeck[0]))
                each += f" (at rest {more} more)"
            known = f"known to {100 * np.max(self.friction_known_to):.3g} %"
            friction = f"{each} {self.control_unit}, {known}, in the runs and in what is proven"
        return {
            "Machine": f"{self.name}: {states}, axes {', '.join(self.axes)}, {time}",
            "Measured": sensors,
            **({"Friction": friction} if self.friction is None or self.largest_friction else {}),
            **({"Backlash": in_words(self.gaps)} if np.any(self.backlash) else {}),
            **({"Note": self.note} if self.note else {}),
        }

    @property
    def measurement_noise(self) -> float | np.ndarray:
        """Standard deviation of measured positions [m], all or each: noisy_count / sqrt(12)."""
        return self.noisy_count / np.sqrt(12)


SAMPLE = 1e-3  # [s] at which the X-Y table is looked at
PERIOD = 4e-3  # [s] of Lam's controllers
# of machines whose motors do not turn a corner at full feed
SMOOTH = USUAL._replace(
    training=("cam", "circle", "ellipse"), held_out=("bracket", "lemniscate"), front=("ellipse",)
)


def bridgeport_machine() -> LinearMachine:
    """McNab & Tsao's X-Y table, its integrators exact; no limits or uncertainty are stated there.

    Weights are the best of those found by hand: Table 1, case II.
    """
    noise = 0.1  # control units: about what an input gain 10 % off does
    return LinearMachine(
        "bridgeport",
        exact_bridgeport(),
        ("X", "Y"),
        "control unit",
        MachineLimits(control=np.full(2, 10.0)),  # read as volts: analogue drives take +-10 V
        Uncertainty(0.1, 2),
        known_delay=0,
        encoder_resolution=ENCODER_RESOLUTION,
        control_noise=noise,
        # the filter estimates no load
        published={"alpha": 1.2, "beta": 20.0, "rho": 2e-9, "control_noise": noise, "drift": 1e-6},
    )


def xy_table_machine() -> LinearMachine:
    """Lam's table modelled without friction; a controller on the host meets it with friction."""
    from jcontour.plants.xy_table import xy_table

    current = 0.5  # [A] section 5
    return LinearMachine(
        "xy-table",
        xy_table(SAMPLE),
        ("X", "Y"),
        "A",
        MachineLimits(control=np.full(2, current)),
        # of the torque constants, as in the mismatched machine of `reproduce lam`
        Uncertainty(gain=0.1, delay=0),
        known_delay=0,
        encoder_resolution=1e-6,  # [m] not printed, the paper feeds the state: usual for a scale
        control_noise=0.01 * current,
        with_friction=_table_with_friction,
        contours=SMOOTH,
    )


def _table_with_friction() -> Hosted:
    """The X-Y table with friction at 1 ms, and its model at the controller's period."""
    from jcontour.plants.xy_table import FrictionXYTable, xy_table

    return Hosted(FrictionXYTable(SAMPLE), xy_table(PERIOD), round(PERIOD / SAMPLE))


def emps_machine() -> LinearMachine:
    """The EMPS drive, twice at right angles, without its dry friction, which is to be rejected."""
    from jcontour.plants.emps import LARGEST_VOLTAGE, RESOLUTION, emps_table

    return LinearMachine(
        "emps",
        emps_table(),
        ("X", "Y"),
        "V",
        MachineLimits(control=np.full(2, LARGEST_VOLTAGE)),
        # not published: a usual tolerance of a drive; its controller runs at 1 kHz beside it
        Uncertainty(gain=0.05, delay=1),
        known_delay=0,
        encoder_resolution=RESOLUTION,
        control_noise=0.05 * LARGEST_VOLTAGE,
        contours=SMOOTH,
    )

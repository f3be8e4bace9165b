"""Cascades on linear machines, and feedforward in front of them, built from gains.

The cascade begins as the fastest of a series that keeps a margin on the whole family. Velocity
loops cross over at w, position loops at a quarter of it:

    k_pv = 1 / (|1 + 1/(j c)| |G_v(w)|),   T_iv = c / w,   k_pp = w / 4

G_v is the response of an axis from control to speed. The series goes through w and c.
"""

import abc
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.app.designs.design import changed
from jcontour.app.designs.gains import Gain, GainDesign, Gains
from jcontour.app.designs.lq.first_loop import SENSITIVITY, sensitivity_peaks, straight_windows
from jcontour.app.flags.shared import Controlled
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.steady_response import steady_response
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedforward.inverse_feedforward import InverseFeedforward
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.controllers.feedforward.preview_filter import PreviewFilter
from jcontour.controllers.feedforward.tuned_inverse import (
    OptimalInverse,
    optimal_filter,
    zero_phase_inverse,
)
from jcontour.controllers.wrappers.speed_by_difference import SpeedByDifference
from jcontour.linear.plant import LinearPlant, decoupled_axes
from jcontour.linear.transfer_functions import TransferFunction, transfer_function
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.wrappers.encoders import Encoders
from jcontour.sensors import Sensors, motors
from jcontour.simulation.evaluation import stack_plants
from tuning.parameters import Interval

CROSSOVERS = np.geomspace(0.5, 3e-3, 16)  # w [rad per sample] from fast to slow
CORNERS = (0.2, 1.0, 3.0)  # c: the first for drives that take a speed, the last for currents
ORDER, CONSTRAINT = 1, 2  # of the model and of the weight: bounded acceleration
SMOOTHING = Gain(0.05, "", Interval(1e-3, 0.3))  # 1/4 is Alter & Tsao's model
WEIGHT = Gain(1.0, "", Interval(0.8, 1.2))  # 1 is theirs: no error on a steady motion


class Scheme(abc.ABC):
    """A cascade and what is in front of it, on one machine.

    Args:
        machine: what it is for.
        flags: delay of the nominal machine, preview, first weights.

    Raises:
        ValueError: a flag is not within what the machine may have.
    """

    def __init__(self, machine: LinearMachine, flags: Controlled):
        self.machine, self.late = machine, _late(machine, flags)

    @abc.abstractmethod
    def gains(self) -> dict[str, Gain]:
        """Gains beside those of the loops."""

    @abc.abstractmethod
    def build(self, gains: Gains) -> Controller:
        """The controller."""


class Plain(Scheme):
    """The cascade alone."""

    def gains(self) -> dict[str, Gain]:
        """None."""
        return {}

    def build(self, gains: Gains) -> Controller:
        """The cascade; of the gains those that it knows."""
        return cascade(self.machine, gains)


class _Inverse(Scheme):
    """The cascade behind an inverse of its nominal machine."""

    def __init__(self, machine: LinearMachine, flags: Controlled):
        super().__init__(machine, flags)
        with jax.ensure_compile_time_eval():
            self.nominal = with_input_delay(machine.model, self.late)
        self.axes = axes_of(self.nominal)

    @abc.abstractmethod
    def ahead(self, gains: Gains) -> PreviewFilter:
        """The inverse."""

    def build(self, gains: Gains) -> Controller:
        """The cascade, whose position loop is fed the speed, behind the inverse."""
        return InverseFeedforward(
            cascade(self.machine, {**gains, "feedforward": 1.0}),
            self.ahead(gains),
            Encoders(self.nominal),
            _limit(self.machine),
        )


class ZeroPhase(_Inverse):
    """Zero phase error tracking."""

    def gains(self) -> dict[str, Gain]:
        """Bandwidth of the model."""
        return {"smoothing": SMOOTHING}

    def ahead(self, gains: Gains) -> PreviewFilter:
        """The zero-phase inverse."""
        return zero_phase_inverse(self.axes, gains["smoothing"])


class Optimal(_Inverse):
    """l1-optimal feedforward.

    Raises:
        ValueError: the preview is shorter than the delay, or an axis has a zero on the unit circle.
    """

    def __init__(self, machine: LinearMachine, flags: Controlled):
        super().__init__(machine, flags)
        following = ModelFollowing(ORDER, flags.preview, CONSTRAINT)
        first = first_numbers(self.gains(), flags)
        self.inverses = [OptimalInverse(axis, following, **first) for axis in self.axes]

    def gains(self) -> dict[str, Gain]:
        """Bandwidth of the model and weight of the error."""
        return {"smoothing": SMOOTHING, "weight": WEIGHT}

    def ahead(self, gains: Gains) -> PreviewFilter:
        """The optimal inverse."""
        return optimal_filter(self.inverses, gains["smoothing"], gains["weight"])


def cascade(machine: LinearMachine, gains: Gains) -> Controller:
    """P-PI on the encoders; of the gains those that it knows."""
    known = {name: gains[name] for name in CascadeGains.__dataclass_fields__ if name in gains}
    axes, dt = len(machine.axes), machine.model.dt
    loops = Cascade(CascadeGains(**known), motors(axes), dt, _limit(machine), machine.holding)
    return SpeedByDifference(loops, Sensors(range(axes)), dt)


def feedforward_design(
    scheme: type[Scheme],
) -> Callable[[str, str, LinearMachine, Controlled], GainDesign]:
    """Maker of a design from a scheme."""

    def design(name: str, line: str, machine: LinearMachine, flags: Controlled) -> GainDesign:
        found = scheme(machine, flags)
        gains = {**first_cascade(machine), **found.gains()}
        return gain_design(name, line, machine, gains, found.build)

    return design


def gain_design(
    name: str,
    line: str,
    machine: LinearMachine,
    gains: dict[str, Gain],
    build: Callable[[Gains], Controller],
) -> GainDesign:
    """Design of a controller on the outputs that `build` makes of its gains."""
    start = {key: gain.start for key, gain in gains.items()}
    space = {key: gain.parameter for key, gain in gains.items()}
    preview = build(start).preview

    def make(_: LinearMachine, values: Gains) -> Controller:
        return build(values)

    return GainDesign(name, machine, start, space, preview, "outputs", make, line, gains)


def first_numbers(gains: dict[str, Gain], flags: Controlled) -> dict[str, float]:
    """Where these gains begin, those of the flags included: the taps of an inverse are of there.

    Raises:
        ValueError: a value is not a number.
    """
    start = {name: gain.start for name, gain in gains.items()}
    named = [one for one in flags.weights if one.partition("=")[0] in start]
    return {name: float(value) for name, value in changed(start, named).items()}


def first_cascade(machine: LinearMachine) -> dict[str, Gain]:
    """Gains of the fastest cascade of the series that keeps the margin on the family."""
    found = fastest(machine, cascades(machine), lambda gains: cascade(machine, gains))
    return {name: Gain(found[name], words) for name, words in cascade_units(machine).items()}


def cascades(machine: LinearMachine) -> list[Gains]:
    """Gains of the series, from fast to slow."""
    axes = axes_of(machine.model)
    return [_loops(axes, w, c) for w, c in product(CROSSOVERS, CORNERS)]


def cascade_units(machine: LinearMachine) -> dict[str, str]:
    """Units of the gains of a cascade."""
    return {"position": "1/s", "velocity": f"{machine.control_unit} s/m", "integral_time": "s"}


def fastest(
    machine: LinearMachine, series: Sequence[Gains], build: Callable[[Gains], Controller]
) -> Gains:
    """The fastest loop of a series that keeps the margin on the family.

    Where none keeps it, that with the smallest peak.

    Args:
        machine: whose family it is.
        series: gains from fast to slow.
        build: makes the controller of such gains.
    """
    stacked = jax.tree.map(lambda *values: jnp.stack([jnp.asarray(v) for v in values]), *series)
    family, windows = stack_plants(machine.smooth_family()), straight_windows(machine, 1)
    peaks = np.asarray(sensitivity_peaks(build, stacked, family, windows, machine.doubt))
    kept = np.flatnonzero(peaks <= SENSITIVITY)
    return series[kept[0] if kept.size else int(np.argmin(peaks))]


def _loops(axes: list[TransferFunction], crossover: float, corner: float) -> dict[str, Any]:
    """Gains of one cascade of the series."""
    point, dt = np.exp(-1j * crossover), axes[0].dt
    speeds = [abs(axis.response(point) * (1 - point)) / dt for axis in axes]
    share = abs(1 + 1 / (1j * corner))
    return {
        "position": float(crossover / dt / 4),
        "velocity": 1 / (share * np.array(speeds)),
        "integral_time": float(corner * dt / crossover),
    }


def motion_gains(machine: LinearMachine) -> dict[str, Gain]:
    """Control that holds a speed, and that of the speed's lag."""
    axes, levels = axes_of(machine.model), level_gains(machine)
    viscous, inertia = zip(*map(_steady_control, axes, levels), strict=True)
    unit = machine.control_unit
    return {
        "inertia": Gain(np.maximum(inertia, 1e-9), f"{unit} s^2/m"),
        "viscous": Gain(np.maximum(viscous, 1e-9), f"{unit} s/m"),
    }


def level_gains(machine: LinearMachine) -> np.ndarray:
    """(m,) control that holds a position, per metre; 0 of axes that stay where they are."""
    steady = [steady_response(machine.model, axis) for axis in range(machine.model.axes)]
    return np.array([1 / one.gain if one.kind == "position" else 0.0 for one in steady])


def _steady_control(axis: TransferFunction, level: float) -> tuple[float, float]:
    """Control per speed and per acceleration of a slow motion: P^-1 = k_0 + k_v s + k_a s^2 + ...

    The cascade's speed is that of half a sample later, which is a share of k_a.
    """
    w = np.array([1e-3, 2e-3]) / axis.dt  # [rad/s]
    s = 1j * w
    inverse = (1 / axis.response(np.exp(-s * axis.dt)) - level) / s  # k_v + k_a s
    viscous = float(np.real(inverse[0]))
    inertia = float(np.imag(inverse[1] - inverse[0]) / (w[1] - w[0]))
    return viscous, inertia - viscous * axis.dt / 2


def axes_of(model: LinearPlant) -> list[TransferFunction]:
    """Transfer function of every axis from its own control.

    Raises:
        ValueError: the axes are coupled, or axis i is not driven by control i.
    """
    for axis in decoupled_axes(model.pattern):
        if axis.inputs != axis.outputs or len(axis.inputs) != 1:
            raise ValueError(
                "feedforward needs axes with one control each: outputs "
                f"{list(axis.outputs)} depend on controls {list(axis.inputs)}"
            )
    return [transfer_function(model, axis, axis) for axis in range(model.axes)]


def _late(machine: LinearMachine, flags: Controlled) -> int:
    """Samples of the unknown delay in the nominal machine.

    Raises:
        ValueError: the flag is not within what the machine may have.
    """
    if flags.model_delay is None:
        return machine.middle_delay
    if not 0 <= flags.model_delay <= machine.delay:
        raise ValueError(
            f"model-delay: {machine.name} may be 0 to {machine.delay} samples late beyond what is "
            f"known, received {flags.model_delay}"
        )
    return flags.model_delay


def _limit(machine: LinearMachine) -> Any:
    return np.inf if machine.limits.control is None else machine.limits.control

"""Cascades on linear machines, and feedforward in front of them, built from gains.

The cascade begins as the fastest of a series that keeps a margin on the whole family. Velocity
loops cross over at w, position loops at a quarter of it:

    k_pv = 1 / (|1 + 1/(j c)| |G_v(w)|),   T_iv = c / w,   k_pp = w / 4

G_v is the response of an axis from control to speed. The series goes through w and c.
"""

from functools import cached_property
from itertools import product
from typing import Any

import jax
import numpy as np

from jcontour.app.designs.design import Gains, LinearDesign
from jcontour.app.designs.lq.first_loop import fastest
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.steady_response import steady_response
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedforward.inverse_feedforward import InverseFeedforward
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.controllers.feedforward.tuned_inverse import (
    OptimalInverse,
    optimal_filter,
    smoothed_inverse,
    zero_phase_inverse,
)
from jcontour.controllers.feedforward.zpetc import PreviewFilter, causal_filter
from jcontour.controllers.wrappers.adapters import SpeedByDifference
from jcontour.linear.plant import LinearPlant, decoupled_axes
from jcontour.linear.transfer_functions import TransferFunction, transfer_function
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.encoders import Encoders
from jcontour.sensors import Sensors, motors
from tuning.parameters import Interval, Weight

CROSSOVERS = np.geomspace(0.5, 3e-3, 16)  # w [rad per sample] from fast to slow
CORNERS = (0.2, 1.0, 3.0)  # c: the first for drives that take a speed, the last for currents
ORDER, CONSTRAINT = 1, 2  # of the model and of the weight: bounded acceleration
# 1/4 is Alter & Tsao's model; their weight is 1: no error on a steady motion
SMOOTHING = Weight("smoothing", range=Interval(1e-3, 0.3), start=0.05)
WEIGHT = Weight("weight", range=Interval(0.8, 1.2), start=1.0)


class LinearCascade(LinearDesign):
    """P-PI cascade on encoders, speeds by difference.

    It is the fastest of the series that keeps the margin on the family.
    """

    weights = (
        Weight("position", "1/s"),
        Weight("velocity", "{control} s/m"),
        Weight("integral_time", "s"),
    )

    def starts(self) -> Gains:
        machine, series = self.machine, cascades(self.machine)
        return series[fastest(machine, series, lambda gains: cascade(machine, gains))]

    def build(self, weights: Gains) -> Controller:
        return cascade(self.machine, weights)


class ZeroPhaseCascade(LinearCascade):
    """Zero phase error tracking (Tomizuka) in front of the cascade."""

    weights = (*LinearCascade.weights, SMOOTHING)
    reads = ("model_delay",)

    @cached_property
    def nominal(self) -> LinearPlant:
        """The machine with its delay."""
        with jax.ensure_compile_time_eval():
            return with_input_delay(self.machine.model, self.late)

    @cached_property
    def axes(self) -> list[TransferFunction]:
        """Axes of the nominal machine."""
        return axes_of(self.nominal)

    def ahead(self, gains: Gains) -> PreviewFilter:
        """The inverse."""
        return zero_phase_inverse(self.axes, gains["smoothing"])

    def build(self, weights: Gains) -> Controller:
        return InverseFeedforward(
            cascade(self.machine, {**weights, "feedforward": 1.0}),  # fed the speed
            self.ahead(weights),
            Encoders(self.nominal),
            _limit(self.machine),
        )


class CausalCascade(ZeroPhaseCascade):
    """Causal inversion of the model in front of the cascade, no preview but its delay."""

    def ahead(self, gains: Gains) -> PreviewFilter:
        return smoothed_inverse([causal_filter(axis) for axis in self.axes], gains["smoothing"])


class OptimalCascade(ZeroPhaseCascade):
    """Feedforward optimal in l1 with preview (Alter & Tsao) in front of the cascade.

    Raises:
        ValueError: the preview is shorter than the delay, or an axis has a zero on the unit circle.
    """

    weights = (*ZeroPhaseCascade.weights, WEIGHT)
    reads = ("preview", "model_delay")

    @cached_property
    def inverses(self) -> list[OptimalInverse]:
        """Inverse of every axis; its taps are those of the first numbers."""
        following = ModelFollowing(ORDER, self.flags.preview, CONSTRAINT)
        first = {name: float(self.start[name]) for name in ("smoothing", "weight")}
        return [OptimalInverse(axis, following, **first) for axis in self.axes]

    def ahead(self, gains: Gains) -> PreviewFilter:
        return optimal_filter(self.inverses, gains["smoothing"], gains["weight"])


def cascade(machine: LinearMachine, gains: Gains) -> Controller:
    """P-PI on the encoders; of the gains those that it knows."""
    known = {name: gains[name] for name in CascadeGains.__dataclass_fields__ if name in gains}
    axes, dt = len(machine.axes), machine.model.dt
    loops = Cascade(CascadeGains(**known), motors(axes), dt, _limit(machine), machine.holding)
    return SpeedByDifference(loops, Sensors(range(axes)), dt)


def cascades(machine: LinearMachine) -> list[Gains]:
    """Gains of the series, from fast to slow."""
    axes = axes_of(machine.model)
    return [_loops(axes, w, c) for w, c in product(CROSSOVERS, CORNERS)]


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


def motion_gains(machine: LinearMachine) -> Gains:
    """Control that holds a speed, and that of the speed's lag."""
    axes, levels = axes_of(machine.model), level_gains(machine)
    viscous, inertia = zip(*map(_steady_control, axes, levels), strict=True)
    return {"inertia": np.maximum(inertia, 1e-9), "viscous": np.maximum(viscous, 1e-9)}


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


def _limit(machine: LinearMachine) -> Any:
    return np.inf if machine.limits.control is None else machine.limits.control

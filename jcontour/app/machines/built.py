"""Machine files from what engineers know: transfer functions, data sheets, step responses."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jcontour.app.files.checks import METRES, named
from jcontour.app.files.log_file import read_step
from jcontour.app.files.machine_file import MOST_DELAY
from jcontour.app.flags.machines import Machine
from jcontour.app.machines.uncertainty import GAIN_KNOWN_TO, LESS_DAMPED, unsure_resonances
from jcontour.linear.continuous_axes import (
    ContinuousAxis,
    force_axis,
    position_axis,
    sampled_machine,
    speed_axis,
    with_resonance,
)
from tuning.identification.step_response import fit_step

PER_AXIS = ("gain", "time_constant_ms", "delay_ms", "resonance_hz", "mass_kg", "viscous")
LIMITS = ("control", "speed", "acceleration")
OF_OTHER_DRIVES = {  # what the control means -> flags that say nothing of such a drive
    "speed": ("mass_kg", "viscous"),
    "position": ("mass_kg", "viscous"),
    "force": ("time_constant_ms",),
}
TRUSTED = 0.98  # of the variance of a step response: less is another kind of axis


@dataclass(frozen=True)
class BuiltMachine:
    """A machine file and where its numbers come from."""

    fields: dict[str, Any]  # of the file
    words: list[str]  # about every axis, one line each
    warnings: list[str]  # what should be looked at


def built_machine(flags: Machine) -> BuiltMachine:
    """Fields of the machine file that the flags describe."""
    names = list(flags.axes)
    if len(set(names)) != len(names) or len(names) not in (2, 3):
        raise ValueError(f"axes: needs two or three different names, received {' '.join(names)}")
    warnings: list[str] = []
    axes, words, dt = _stepped(flags, warnings) if flags.steps else _described(flags)
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"period-ms: needs to be above zero, received {1e3 * dt:g}")
    for name, axis in zip(names, axes, strict=True):
        fastest = float(np.abs(np.linalg.eigvals(axis.A).imag).max())
        if fastest * dt >= np.pi:
            raise ValueError(
                f"period-ms: the resonance of {name} at {fastest / (2 * np.pi):.4g} Hz needs more "
                f"than two samples a period; {1e3 * dt:g} ms is too long"
            )
    plant, shared = sampled_machine(axes, dt)
    if shared > MOST_DELAY:
        raise ValueError(
            f"delay-ms: {shared} samples of {1e3 * dt:g} ms, "
            f"known delays are of at most {MOST_DELAY}"
        )
    metre = METRES[flags.length_unit]
    # Limits of the file: one number where one is given, else one for each axis
    limits: dict[str, float | list[float]] = {}
    for name in LIMITS:
        given = _above_zero(f"max_{name}", getattr(flags, f"max_{name}"), len(flags.axes))
        if given is not None:
            limits[name] = _short(given)
    counts = _above_zero("encoder_um", flags.encoder_um, len(flags.axes))
    if counts is None:
        raise ValueError("encoder-um: needs one number or one for each axis, received none")
    known_to = GAIN_KNOWN_TO[flags.takes]
    if flags.gain_uncertainty is not None:
        known_to = flags.gain_uncertainty
    uncertainty: dict[str, Any] = {"gain": known_to, "delay": flags.delay_uncertainty}
    # How far off the response may be beside resonances
    part, hertz = flags.resonance_uncertainty, _each("resonance_hz", flags.resonance_hz, len(names))
    if not 0 <= part < 1:
        raise ValueError(f"resonance-uncertainty: needs a fraction below 1, received {part:g}")
    if part > 0 and hertz is not None and any(hertz):
        uncertainty["response"] = unsure_resonances(hertz, flags.damping, part, dt)
    fields = {
        "name": flags.name,
        "length_unit": flags.length_unit,
        "control_unit": flags.control_unit,
        "axes": names,
        "dt": dt,
        "A": np.asarray(plant.A).tolist(),
        "B": np.asarray(plant.B).tolist(),
        "C": (np.asarray(plant.C) / metre).tolist(),
        "limits": limits,
        "known_delay": shared,
        "uncertainty": uncertainty,
        "encoder_resolution": _short([one * METRES["um"] / metre for one in counts]),
    }
    return BuiltMachine(fields, words, warnings)


def _short(values: list[float]) -> float | list[float]:
    """One number where it is that of every axis."""
    return values[0] if len(set(values)) == 1 else values


def _described(flags: Machine) -> tuple[list[ContinuousAxis], list[str], float]:
    """Axes of a transfer function or a data sheet."""
    count, numbers = len(flags.axes), {}
    for name in PER_AXIS:
        numbers[name] = _each(name, getattr(flags, name), count)
        for value in numbers[name] or ():
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{_flag(name)}: needs to be at least zero, received {value:g}")
    needed = {"speed": ("gain",), "position": ("gain", "time_constant_ms")}
    for name in needed.get(flags.takes, ("gain", "mass_kg")):
        if numbers[name] is None:
            raise ValueError(
                f"{_flag(name)}: missing; a drive that takes a {flags.takes} needs it "
                "(or give --steps, a step response for each axis)"
            )
    for name in OF_OTHER_DRIVES[flags.takes]:
        if numbers[name] is not None:
            raise ValueError(
                f"{_flag(name)}: says nothing of a drive that takes a {flags.takes}; leave it out, "
                "or give another --takes"
            )
    per_metre = METRES[flags.length_unit] if flags.takes != "force" else 1.0  # a force is in N
    axes, words = [], []
    for k, name in enumerate(flags.axes):
        one = {key: 0.0 if values is None else values[k] for key, values in numbers.items()}
        gain, late, constant = per_metre * one["gain"], one["delay_ms"], one["time_constant_ms"]
        lag = f"({constant:g} ms s + 1)" if constant else ""
        if flags.takes == "speed":
            axis, below = speed_axis(gain, 1e-3 * constant, 1e-3 * late), f"s {lag}".strip()
        elif flags.takes == "position":
            axis, below = position_axis(gain, 1e-3 * constant, 1e-3 * late), lag
        else:
            axis = force_axis(gain, one["mass_kg"], one["viscous"], 1e-3 * late)
            below = f"({one['mass_kg']:g} kg s^2 + {one['viscous']:g} N s/m s)"
        formula = f"{one['gain']:g}{f' exp(-{late:g} ms s)' if late else ''} / {below}"
        if hertz := one["resonance_hz"]:
            axis = with_resonance(axis, 2 * np.pi * hertz, flags.damping)
            part, z = flags.resonance_uncertainty, flags.damping
            formula += f", resonance at {hertz:g} Hz"
            if part == 0:
                formula += f", damping {z:g}"
            else:
                unsure = f"+- {100 * part:g} %, damping {LESS_DAMPED * z:g} to {z:g}"
                formula += f" ({unsure}: tuned loops stay stable)"
        axes.append(axis)
        words.append(f"{name}: {formula}")
    return axes, words, 1e-3 * flags.period_ms


def _stepped(flags: Machine, warnings: list[str]) -> tuple[list[ContinuousAxis], list[str], float]:
    """Axes of step responses, all sampled alike."""
    if flags.takes == "force":
        raise ValueError("takes: a step response is of a drive that takes a speed or a position")
    given = [_flag(name) for name in PER_AXIS if getattr(flags, name)]
    if given:
        raise ValueError(f"{given[0]}: the step responses say it; leave it out")
    if len(flags.steps) != len(flags.axes):
        raise ValueError(
            f"steps: needs a file for each of the {len(flags.axes)} axes, "
            f"received {len(flags.steps)}"
        )
    records = [read_step(path, flags.length_unit) for path in flags.steps]
    dt = records[0].dt
    if any(abs(one.dt / dt - 1) > 1e-3 for one in records):
        raise ValueError("steps: all axes need the same sample period")
    axes, words = [], []
    for path, one in zip(flags.steps, records, strict=True):
        warnings.extend(f"{path}: {said}" for said in one.words[1:])  # behind names of columns
    for name, path, one in zip(flags.axes, flags.steps, records, strict=True):
        with named(path):
            fit = fit_step(one.command[:, 0], one.position[:, 0], one.dt, flags.takes)
        make = speed_axis if flags.takes == "speed" else position_axis
        axes.append(make(fit.gain, fit.time_constant, fit.delay))
        words.append(
            f"{name}: gain {fit.gain / METRES[flags.length_unit]:.4g}, time constant "
            f"{1e3 * fit.time_constant:.4g} ms, delay {1e3 * fit.delay:.3g} ms; "
            f"left unexplained {1e6 * fit.residual:.3g} um RMS"
        )
        if fit.explained < TRUSTED:
            warnings.append(
                f"{path}: the model explains {100 * fit.explained:.3g} % of the record; "
                f"does the drive take a {flags.takes}, or are columns swapped?"
            )
    # The period without the rounding of printed times: to a nanosecond
    return axes, words, round(dt, 9)


def _each(name: str, values: Sequence[float], count: int) -> list[float] | None:
    """One number for each axis, given once or each; None where none is given."""
    if not values:
        return None
    if len(values) not in (1, count):
        raise ValueError(f"{_flag(name)}: needs one number or {count}, received {len(values)}")
    return list(values) * (count // len(values))


def _above_zero(name: str, values: Sequence[float], count: int) -> list[float] | None:
    """As `_each`, of what needs to be above zero."""
    each = _each(name, values, count)
    for value in each or ():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{_flag(name)}: needs to be above zero, received {value:g}")
    return each


def _flag(name: str) -> str:
    return name.replace("_", "-")

"""Machine files and summaries of machines that were identified from a log."""

import json
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from jcontour.app.files.results.machine_results import LinearAxisResult
from jcontour.app.flags.machines import Machine
from jcontour.app.machines.from_file import machine_from
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.uncertainty import FRICTION_KNOWN_TO, moved, places_around
from tuning.identification.linear import validation
from tuning.identification.linear.axis_model import AxisModel, other_amplitudes, two_masses
from tuning.identification.linear.identified_axes import IdentifiedAxis, IdentifiedMachine

ROUGH = 4  # windows over which the largest acceleration is taken
MOST_LINES = 200  # of what was measured of an axis
THINNED = 4  # frequencies of the intervals for one of the file, but around sharp modes
HARDLY = 0.9  # to which friction is known at the worst
UNKNOWN = 1e4  # |G_true / G - 1| that stands for more
ALIKE = 1.01  # ratio of counts that a log does not tell apart
RINGS = 0.3  # damping below which a pair of poles is a resonance: it answers 1.75 times
DISTURBED = 10.0  # times the noise of the encoder, from which on it is a disturbance
HIGH = 99.9  # percentile that counts as the largest: encoders have outliers


def machine_fields(identified: IdentifiedMachine, name: str, control_unit: str) -> dict[str, Any]:
    """Fields of the machine file, lengths in m; the format is `files.machine_file`'s.

    Limits are the largest values of the record: what is known to have gone well.
    """
    plant = identified.plant()
    # Intervals of the responses at a few frequencies, the largest around each
    dt, modes = identified.record.dt, [_modes(one.fit.model)[1] for one in identified.axes]
    modes = [[(hertz, damping) for hertz, damping in each if damping < RINGS] for each in modes]
    places = [places_around(hertz, dt) for each in modes for hertz, _ in each]
    own = [_thinned(one.response.frequency) for one in identified.axes]
    kept = np.unique([float(f"{one:.6g}") for one in np.concatenate([*own, *places])])
    frequency = np.union1d(
        kept, np.concatenate([one.response.frequency for one in identified.axes])
    )
    edges = np.sqrt(kept[1:] * kept[:-1])
    rows = []
    for one, ringing in zip(identified.axes, modes, strict=True):
        width = np.interp(
            np.log(frequency), np.log(one.response.frequency), one.response.half_width
        )
        for hertz, damping in ringing:
            floor = moved(hertz, damping, Machine.resonance_uncertainty, frequency)
            width = np.maximum(width, floor)
        parts = np.split(np.minimum(width, UNKNOWN), np.searchsorted(frequency, edges))
        rows.append([float(f"{part.max():.3g}") for part in parts])
    apart = [
        other_amplitudes(one.fit.model, 2 * np.pi * one.lines.frequency.max(initial=0.0))
        for one in identified.axes
    ]
    loose = [_lines(w / (2 * np.pi), off, 0.0 * w) for w, off in apart]
    fields = {
        "name": name,
        "length_unit": "m",
        "control_unit": control_unit,
        "axes": list(identified.record.axes),
        "dt": identified.record.dt,
        "A": np.asarray(plant.A).tolist(),
        "B": np.asarray(plant.B).tolist(),
        "C": np.asarray(plant.C).tolist(),
        "limits": largest(identified),
        "known_delay": identified.known_delay,
        "uncertainty": {
            "gain": identified.gain,
            "delay": identified.late,
            "response": {"hertz": kept.tolist(), "relative": rows},
            "measured": _columns([_measured(one) for one in identified.axes]),
            **({"other_amplitudes": _columns(loose)} if any(len(w) for w, _ in apart) else {}),
        },
        "encoder_resolution": counts(identified),
        "encoder_noise": noises(identified),
        "friction": _friction(identified),
        **_stribeck(identified),
    }
    # What moves a drive that takes a position beside its command, where that is much
    left, at_rest = _unexplained(identified, fields)
    changes, parts = [one.ripple for one in identified.axes], []
    for k, one in enumerate(identified.axes):
        if one.fit.model.integrators:
            continue
        if one.friction is not None:
            changes[k] = at_rest[k] / abs(_gain(one)[0] * one.friction[0])
        noise = np.hypot(one.resolution / np.sqrt(12), one.encoder_noise)
        if left[k] > DISTURBED * noise:
            parts.append(f"{1e6 * left[k]:.3g} um on {one.name}")
    fields["friction_known_to"] = np.minimum(np.hypot(FRICTION_KNOWN_TO, changes), HARDLY).tolist()
    if parts:
        unexplained = f"the record holds {', '.join(parts)} RMS that the command does not explain"
        fields["note"] = f"{unexplained}: the machine has it beside every error of a run here"
    return fields


def _unexplained(
    identified: IdentifiedMachine, fields: dict[str, Any]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """RMS position that a file's machine leaves of its record [m]: of all of it, and at rest.

    Friction stops a drive that holds its place anywhere within its reversal error.
    """
    record, machine = identified.record, machine_from(json.dumps(fields).encode())
    assert isinstance(machine, LinearMachine)
    plant = machine.mechanics
    start = plant.initial_state(record.position[0], 0.0 * record.position[0])
    commands = jax.numpy.asarray(record.command)
    _, output = jax.lax.scan(lambda x, u: (plant.step(x, u), plant.output(x)), start, commands)
    each = zip(record.position.T, identified.axes, strict=True)
    moves = np.stack([validation.speed_signs(y, one.resolution) for y, one in each], axis=1) != 0
    began = np.cumsum(moves, axis=0) > 0
    left = record.position - np.asarray(output)
    left = left - np.mean(left, axis=0, where=moves)  # a record may have its zero elsewhere
    parts = began, began & ~moves
    whole, still = (np.sum(left**2, 0, where=one) / np.maximum(one.sum(0), 1) for one in parts)
    return np.sqrt(whole), np.sqrt(still)


def _friction(identified: IdentifiedMachine) -> float | list[float] | None:
    """Command that dry friction takes by axis; None where it could not be separated on some."""
    if any(one.hides_friction for one in identified.axes):
        return None
    each = [0.0 if one.friction is None else one.friction[0] for one in identified.axes]
    return each if any(each) else 0.0


def _stribeck(identified: IdentifiedMachine) -> dict[str, list[float]]:
    """What it takes more at rest, and the speed at which half of that is left, where it is seen."""
    each = [one.stribeck or (0.0, 1.0) for one in identified.axes]
    if not any(more for more, _ in each) or _friction(identified) is None:
        return {}
    return {
        "stribeck_friction": [more for more, _ in each],
        "stribeck_speed": [speed for _, speed in each],
    }


def _measured(axis: IdentifiedAxis) -> dict[str, list[float]]:
    """Of one axis, relative to its model, at `MOST_LINES` frequencies."""
    lines = axis.lines
    part = slice(None, None, -(-len(lines.frequency) // MOST_LINES) or 1)
    G = axis.fit.model.response(2 * np.pi * lines.frequency)
    off = lines.value / G - 1
    width = lines.half_width * np.abs(1 + off)
    return _lines(*(column[part] for column in (lines.frequency, off, width)))


def _lines(hertz: np.ndarray, off: np.ndarray, width: np.ndarray) -> dict[str, list[float]]:
    columns = {"hertz": hertz, "real": np.real(off), "imaginary": np.imag(off), "half_width": width}
    return {name: [float(f"{one:.4g}") for one in column] for name, column in columns.items()}


def _columns(axes: list[dict[str, list[float]]]) -> dict[str, list[list[float]]]:
    """The same of all axes."""
    return {name: [one[name] for one in axes] for name in axes[0]}


def _thinned(frequency: Float[np.ndarray, " F"]) -> Float[np.ndarray, " K"]:
    """Every `THINNED`-th of the usual frequencies, and all that lie closer together."""
    gaps = np.diff(np.log(frequency))
    close = np.append(gaps < 0.5 * gaps.max(), False)
    close[1:] |= close[:-1]
    return np.sort(np.concatenate([frequency[close], frequency[~close][::THINNED]]))


def largest(identified: IdentifiedMachine) -> dict[str, list[float]]:
    """Largest speed [m/s], acceleration [m/s^2] and command of the record, by axis."""
    dt, window = identified.record.dt, validation.WINDOW
    speed = _differences(identified.record.position, window) / (window * dt)
    wide = ROUGH * window
    smooth = _differences(identified.record.position, wide) / (wide * dt)
    acceleration = _differences(smooth, wide) / (wide * dt)
    return {
        "speed": np.percentile(np.abs(speed), HIGH, axis=0).tolist(),
        "acceleration": np.percentile(np.abs(acceleration), HIGH, axis=0).tolist(),
        "control": np.abs(identified.record.command).max(axis=0).tolist(),
    }


def counts(identified: IdentifiedMachine) -> float | list[float]:
    """Counts of the encoders by axis [m]; one number, the coarsest, where they hardly differ."""
    each = [one.resolution for one in identified.axes]
    return max(each) if max(each) <= ALIKE * min(each) else each


def noises(identified: IdentifiedMachine) -> float | list[float]:
    """Noise of the encoders beside their counts, by axis [m]; one number where all have none."""
    each = [one.encoder_noise for one in identified.axes]
    return each if any(each) else 0.0


def axis_result(axis: IdentifiedAxis) -> LinearAxisResult:
    """Numbers of one axis."""
    fit, model = axis.fit, axis.fit.model
    gain, half = _gain(axis)
    constants, resonances = _modes(model)
    low, high = axis.response.band
    names = [name for name in axis.estimate.names if name not in validation.DRAGS]
    return LinearAxisResult(
        name=axis.name,
        integrators=model.integrators,
        order=model.order,
        delay=model.delay,
        gain=gain,
        gain_interval=(gain - half, gain + half),
        time_constants=constants,
        resonances=resonances,
        denominator=model.denominator.tolist(),
        numerator=model.numerator.tolist(),
        intervals=[axis.estimate.interval(name) for name in names],
        explained=axis.explained,
        residual=float(np.sqrt(np.mean(fit.residual**2))),
        innovation=float(np.sqrt(fit.loss)),
        correlation=float(np.abs(validation.correlations(fit)).max()),
        shown_from=low,
        shown_to=high,
        measured_to=float(axis.lines.frequency.max(initial=0.0)),
        friction=None if axis.friction is None else axis.friction[0],
        offset=axis.offset,
        saturated=axis.saturated,
        coupling=axis.coupling,
        uncertainty=axis.gain,
    )


def mass_words(axis: IdentifiedAxis, force: float, rotary: bool) -> str:
    """Masses and stiffness of an axis in a line.

    Args:
        axis: identified.
        force: of one unit of its command [N or N m].
        rotary: whether its position is an angle [rad].
    """
    mass, stiffness = ("kg m^2", "N m/rad") if rotary else ("kg", "N/m")
    if (pair := two_masses(axis.fit.model, force)) is not None:
        return (
            f"{axis.name}: motor {pair.motor:.3g} and load {pair.load:.3g} {mass} on a spring of "
            f"{pair.stiffness:.4g} {stiffness}, if its encoder is at the motor"
        )
    gain, (constants, _) = _gain(axis)[0], _modes(axis.fit.model)
    if not (axis.fit.model.integrators and constants):
        return f"{axis.name}: its model has no mass: the drive closes a loop around it"
    viscous = force / gain
    unit = stiffness.replace("N", "N s", 1)
    return f"{axis.name}: {viscous * constants[0]:.4g} {mass}, viscous {viscous:.4g} {unit}"


def _gain(axis: IdentifiedAxis) -> tuple[float, float]:
    """Gain at rest, B(1) / A(1), per second where there is an integrator; its interval, half of it.

    The interval is that of the response at its lowest frequency, or what drives repeat to.
    """
    model = axis.fit.model
    value = model.numerator.sum() / (1 + model.denominator.sum()) / model.dt**model.integrators
    return float(value), float(abs(value) * max(axis.response.half_width[0], axis.gain))


def _modes(model: AxisModel) -> tuple[list[float], list[tuple[float, float]]]:
    """Time constants [s] of real poles in (0, 1), frequency [Hz] and damping of the pairs."""
    constants, pairs = [], []
    for pole in model.poles:
        if abs(pole) < 1e-12:
            continue
        rate = np.log(pole) / model.dt
        if abs(pole.imag) < 1e-9 and pole.real > 0:
            constants.append(float(-1 / rate.real))
        elif pole.imag > 0:
            pairs.append((float(abs(rate) / (2 * np.pi)), float(-rate.real / abs(rate))))
    return sorted(constants, reverse=True), sorted(pairs)


def _differences(signal: Float[np.ndarray, "T axes"], window: int) -> np.ndarray:
    window = min(window, len(signal) - 1)
    return signal[window:] - signal[:-window]

"""What is not known about a machine: its input gains, further delay, its frequency response.

Stated under `uncertainty` of a machine file, or as `UNCERTAINTY` in a Python file with a plant.
Where nothing is stated the usual is assumed, as `jcontour machine` writes it.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.analysis.uncertain_loops import Doubt, Lines
from jcontour.app.files.checks import MachineError
from jcontour.app.files.machine_file import MeasuredFields, UncertaintyFields
from jcontour.app.files.schema import read
from jcontour.app.machines.steady_response import steady_response
from jcontour.linear.plant import LinearPlant

GAIN_KNOWN_TO = {  # a data sheet is seldom better; a position drive follows its own encoder
    "speed": 0.1,
    "position": 0.0,
    "force": 0.1,
}
LATE = 1  # sample: what a drive's bus takes
IN_FILE, IN_PYTHON = '"uncertainty":', "UNCERTAINTY ="  # how a file states it


class Uncertainty(NamedTuple):
    """What is not known about a machine.

    Attributes:
        gain: relative uncertainty of the input gains.
        delay: most samples of delay that the model does not know.
        response: how far off the frequency response may be beside these; None where nothing is
            said.
    """

    gain: float
    delay: int
    response: Doubt | None = None


class Member(NamedTuple):
    """A plant of the family: name, input gains (p,) and extra delay [samples]."""

    name: str
    gains: np.ndarray
    late: float


def stated_uncertainty(given: Any, model: LinearPlant) -> Uncertainty:
    """What a file states, the usual where it states nothing at all (None).

    Raises:
        MachineError: a field is wrong.
    """
    if given is None:
        # Gains known to 10 %, those of a drive that takes a position exactly; a sample late
        kinds = [steady_response(model, axis).kind for axis in range(model.axes)]
        takes: Literal["position", "speed"] = "position" if "position" in kinds else "speed"
        return Uncertainty(GAIN_KNOWN_TO[takes], LATE)
    fields = read(UncertaintyFields, given, "uncertainty")
    return Uncertainty(fields.gain, fields.delay, _doubt(fields, model))


def assumed(name: str, gain: float, delay: int, statement: str) -> str:
    """A line of what is assumed where nothing is stated, and of how to state it."""
    gains = f"gains {100 * gain:g} % off both ways and " if gain else ""
    samples = "a sample" if delay == 1 else f"{delay} samples"
    return (
        f"{name}: its file does not say how well it is known, so it may have {gains}"
        f'{samples} of delay more; {statement} {{"gain": 0.05, "delay": 2}} in it says otherwise'
    )


def family_members(inputs: int, gain: float, delay: int) -> list[Member]:
    """The nominal plant, gains off both ways, and every whole sample of delay."""
    sign = np.where(np.arange(inputs) % 2 == 0, 1.0, -1.0)
    unchanged = 1 + 0 * sign
    found = [Member("nominal", unchanged, 0)]
    for side in (1, -1) if gain > 0 else ():
        gains = 1 + side * gain * sign
        found.append(Member(_gains(gains), gains, 0))
    found += [Member(_late(late), unchanged, late) for late in range(1, delay + 1)]
    return found


def _gains(gains: Float[np.ndarray, " p"]) -> str:
    return "gains " + ", ".join(f"{one:.3g}" for one in gains)


def _late(samples: float) -> str:
    return f"{samples:.3g} {'sample' if samples == 1 else 'samples'} late"


def random_members(count: int, seed: int, inputs: int, gain: float, delay: int) -> list[Member]:
    """Plants with gains and delays drawn evenly from their intervals, then their corners.

    A delay has parts of a sample.
    """
    random = np.random.default_rng(seed)
    gains = 1 + gain * random.uniform(-1, 1, (count, inputs))
    delays = random.uniform(0, delay, count)
    low, high = [1 - gain] * inputs + [0.0], [1 + gain] * inputs + [float(delay)]
    drawn = with_corners(np.column_stack([gains, delays]), low, high)
    return [
        Member(f"{_gains(gains)}, {_late(late)}", gains, float(late))
        for gains, late in zip(drawn[:, :-1], drawn[:, -1], strict=True)
    ]


def with_corners(
    drawn: Float[np.ndarray, "n d"], low: Sequence[float], high: Sequence[float]
) -> Float[np.ndarray, "n d"]:
    """Draws from intervals, the last of them replaced by the corners where there are more draws.

    >>> with_corners(np.full((5, 2), 0.5), [0.0, 0.0], [1.0, 2.0])[1:].tolist()
    [[0.0, 0.0], [0.0, 2.0], [1.0, 0.0], [1.0, 2.0]]
    """
    corners = np.array(list(product(*zip(low, high, strict=True))))
    kept = len(drawn) - len(corners)
    return drawn if kept < 1 else np.concatenate([drawn[:kept], corners])


def _lines(one: MeasuredFields | None, plant: LinearPlant) -> tuple[Lines, ...]:
    """What a file says was measured behind each control; empty where it says nothing."""
    if one is None:
        return ()
    fields = (one.hertz, one.real, one.imaginary, one.half_width)
    if any(len(field) != plant.axes for field in fields):
        raise MachineError(f"uncertainty.measured: needs {plant.axes} lists in every field")
    found = []
    for axis in zip(*fields, strict=True):
        if len({len(part) for part in axis}) > 1:
            raise MachineError("uncertainty.measured: its lists need one number per frequency")
        hertz, real, imaginary, half_width = (np.array(part) for part in axis)
        if np.any(hertz <= 0) or np.any(hertz * plant.dt > 0.5) or np.any(half_width < 0):
            raise MachineError("uncertainty.measured: needs frequencies up to half the sample rate")
        found.append(Lines(2 * np.pi * plant.dt * hertz, real + 1j * imaginary, half_width))
    return tuple(found)


def _doubt(fields: UncertaintyFields, plant: LinearPlant) -> Doubt | None:
    """What a file says of the response; a frequency in rad per sample."""
    given, lines = fields.response, _lines(fields.measured, plant)
    if given is None:
        return Doubt(np.ones(1), np.zeros((1, plant.axes)), lines) if lines else None
    name, highest = "uncertainty.response", 1 / (2 * plant.dt)
    hertz, relative = np.array(given.hertz), np.array(given.relative)
    if not (hertz[0] > 0 and np.all(np.diff(hertz) > 0) and hertz[-1] <= highest):
        raise MachineError(f"{name}.hertz: needs rising frequencies above 0, up to {highest:g} Hz")
    if relative.shape != (plant.axes, hertz.size) or relative.min() < 0:
        raise MachineError(
            f"{name}.relative: needs {plant.axes} rows of {hertz.size} numbers of at least 0"
        )
    return Doubt(2 * np.pi * plant.dt * hertz, relative.T, lines)

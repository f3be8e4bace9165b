"""Why a bounded MPC cannot answer a force, in the names and units of the machine."""

import re

import numpy as np

from jcontour.app.machines.linear import LinearMachine
from jcontour.sets.least_peaks import NoResponse

_SIGNAL = re.compile(r"^(speed|control)(?: (\d+))?(?=: )")  # what a message begins with


def no_answer(machine: LinearMachine, force: float, refused: ValueError) -> str:
    """One line: the force, where it comes from, and which limit is too small for an answer.

    Args:
        machine: with a limit on its controls.
        force: bound on what adds to each control [control unit].
        refused: why there is no response.
    """
    why = _SIGNAL.sub(lambda found: _begin(machine, found[1], found[2]), str(refused))
    if isinstance(refused, NoResponse) and refused.needed:
        why = "; ".join(
            _too_small(machine, name, refused.asked[name], needed)
            for name, needed in refused.needed.items()
        )
    return (
        f"force: {force:g} {machine.control_unit} on every control ({_origin(machine, force)}) "
        f"leaves nothing to answer it with: {why}"
    )


def _origin(machine: LinearMachine, force: float) -> str:
    """The force as a share of the limits, and who sets it."""
    share = force / float(np.min(np.asarray(machine.limits.control)))
    usual = np.isclose(force, max(machine.control_noise, machine.largest_friction))
    return (
        f"{100 * share:.3g} % of the smallest control limit{' by default' if usual else ''}; "
        "--force sets it"
    )


def _too_small(machine: LinearMachine, name: str, left: float, needed: float) -> str:
    """What is left of a limit, and what would do; signals are named `speed 2` or `control`."""
    kind, _, number = name.partition(" ")
    unit = _unit(machine, kind)
    limits = np.asarray(machine.limits.speed if kind == "speed" else machine.limits.control)
    limit = float(limits[_index(number)])
    rest = f"{left:.3g} {unit} is left of the limit of {limit:.4g} {unit}"
    return f"{_named(machine, kind, number)}: {rest}, {needed:.3g} {unit} would do"


def _named(machine: LinearMachine, kind: str, number: str | None) -> str:
    """A speed by its axis, a control by its input."""
    index = _index(number)
    return f"{kind} of {machine.axes[index] if kind == 'speed' else f'input {index + 1}'}"


def _begin(machine: LinearMachine, kind: str, number: str | None) -> str:
    """Begin of a message whose numbers have no unit."""
    return f"{_named(machine, kind, number)} in {_unit(machine, kind)}"


def _unit(machine: LinearMachine, kind: str) -> str:
    return "m/s" if kind == "speed" else machine.control_unit


def _index(number: str | None) -> int:
    return int(number or 1) - 1

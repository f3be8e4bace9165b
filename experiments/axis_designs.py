"""Controllers of flexible axes as the commands see them: put together from parts, each with gains of its own."""

from collections.abc import Callable

from experiments.axis_laws import Law, Part
from experiments.axis_machines import FlexibleMachine
from experiments.gain_designs import GainDesign
from experiments.machines import Machine
from experiments.options import Controlled


def axis_design(line: str, law: Law, *gains: Part, axes: int = 1) -> Callable[[str, Machine, Controlled], GainDesign]:
    """Maker of a design from its parts: each part names its gains; a law along a contour needs two axes or more."""

    def make(name: str, machine: Machine, flags: Controlled) -> GainDesign:
        if not isinstance(machine, FlexibleMachine):
            raise ValueError(f"controller: {name} needs a flexible axis; {machine.name} takes {machine.usual.controller}")
        if len(machine.axes) < axes:
            raise ValueError(f"controller: {name} needs {axes} axes, for a contour; {machine.name} has {len(machine.axes)}")
        named = {key: gain for part in gains for key, gain in part(machine).items()}
        start = {key: gain.start for key, gain in named.items()}
        space = {key: gain.parameter for key, gain in named.items()}
        return GainDesign(name, machine, start, space, 1, "outputs", law, line, named)

    return make

"""Controllers of flexible axes as the commands see them: put together from parts, each with gains of its own."""

from collections.abc import Callable

from experiments.designs.flexible_axis import Law, Part
from experiments.designs.gains import GainDesign
from experiments.machines.flexible_axis import FlexibleMachine
from experiments.options import Controlled


def axis_design(line: str, law: Law, *gains: Part) -> Callable[[str, FlexibleMachine, Controlled], GainDesign]:
    """Maker of a design from its parts: each part names its gains."""

    def make(name: str, machine: FlexibleMachine, flags: Controlled) -> GainDesign:
        named = {key: gain for part in gains for key, gain in part(machine).items()}
        start = {key: gain.start for key, gain in named.items()}
        space = {key: gain.parameter for key, gain in named.items()}
        return GainDesign(name, machine, start, space, 1, "outputs", law, line, named)

    return make

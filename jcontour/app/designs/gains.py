"""Controllers whose weights are gains with names, as the commands see them.

A gain is one number, or one for each axis.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from jcontour.app.designs.design import Design
from jcontour.app.files import run_folder
from jcontour.app.jobs.replays import Scenarios
from jcontour.controller import Controller
from tuning.parameters import Parameter, Positive

Gains = dict[str, Any]  # name -> number, or one for each axis


class Gain(NamedTuple):
    """Where a gain begins, its unit, where it may go, and whether it is a weight of a cost."""

    start: Any
    unit: str
    parameter: Parameter = Positive()
    cost: bool = False


@dataclass(frozen=True)
class GainDesign(Design):
    """A controller whose weights are gains with names.

    Attributes:
        make: makes the controller of the machine from its gains.
        line: description in one line.
        gains: those that are tuned.
        chosen: settings besides the preview that are chosen and not tuned.
    """

    make: Callable[[Any, Gains], Controller]
    line: str
    gains: dict[str, Gain]
    chosen: Mapping[str, Any] = field(default_factory=dict)

    def build(self, weights: Gains) -> Controller:
        """The controller with these gains."""
        return self.make(self.machine, weights)

    @property
    def costs(self) -> frozenset[str]:
        """Those among the gains that say so."""
        return frozenset(name for name, gain in self.gains.items() if gain.cost)

    def units(self) -> dict[str, str]:
        """Those of the gains."""
        return {name: gain.unit for name, gain in self.gains.items()}

    def settings(self) -> dict[str, Any]:
        """Preview, and what else is chosen."""
        return {"preview": self.preview, **self.chosen}

    def description(self) -> dict[str, str]:
        """Controller, and where its gains start."""
        start = ", ".join(f"{name} {_words(self.start[name])}" for name in self.free())
        return {"Controller": self.line, "Free": f"start {start}"}

    def weight_lines(self, weights: dict[str, Any]) -> list[str]:
        """Every gain with its unit."""
        width = max(map(len, weights))
        return [
            f"{name:<{width}}  {_words(value)} {self.gains[name].unit}".rstrip()
            for name, value in weights.items()
        ]

    @property
    def files(self) -> dict[str, str]:
        """One file."""
        return {"controller.json": "every number of the controller by its place, SI units"}

    def save(self, controller: Controller, scenarios: Scenarios, folder: Path) -> None:
        """All numbers of the controller, whatever is inside, by their place."""
        run_folder.write_json(
            folder / "controller.json",
            {"dt": self.machine.model.dt, "controller": self.line, "numbers": _numbers(controller)},
        )


def _words(value: Any) -> str:
    numbers = [value] if isinstance(value, float) else np.ravel(value)
    return ", ".join(f"{float(number):.6g}" for number in numbers)


def _numbers(controller: Controller) -> dict[str, Any]:
    leaves = jax.tree_util.tree_leaves_with_path(eqx.filter(controller, eqx.is_inexact_array))
    return {
        jax.tree_util.keystr(path).lstrip("."): np.asarray(leaf).tolist() for path, leaf in leaves
    }

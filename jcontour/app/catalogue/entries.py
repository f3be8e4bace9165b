"""Entries of the catalogue: a name is the key, a line describes the thing.

Its maker is imported when the thing is made.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:  # a question about a name imports none of these
    from jcontour.app.designs.design import Design
    from jcontour.app.flags.shared import Controlled
    from jcontour.app.jobs.job import Pace, Task
    from jcontour.app.machines.machine import Machine
    from jcontour.plant import Plant

# name, line, machine (one that the entry suits), flags
MakeDesign = Callable[[str, str, Any, "Controlled"], "Design"]


class Requirement(NamedTuple):
    """Kind of machine that a controller is for: in words, and as a test of a machine."""

    words: str
    met_by: Callable[["Machine"], bool]

    def __call__(self, machine: "Machine") -> bool:
        """Whether the machine is of this kind."""
        return self.met_by(machine)


class PlantEntry(NamedTuple):
    """A plant of the contract tests.

    Attributes:
        make: makes the plant.
        line: description in one line.
        machine: makes the machine that it is a plant of.
        smooth: differentiable where it is used.
        stable: it settles without control.
        still: it stays where it is at rest without control.
    """

    make: Callable[[], "Plant"]
    line: str
    machine: Callable[[], "Machine"]
    smooth: bool = True
    stable: bool = True
    still: bool = True


class ControllerEntry(NamedTuple):
    """A controller that the commands tune and simulate.

    Attributes:
        line: description in one line.
        suits: kind of machine that it is for.
        designs: makers of the designs of this kind by name, imported when called.
        alias: shorter name that also stands for it on the machines that it suits.
        smooth: differentiable where it is used.
        stable: the closed loop settles.
        learns: it changes while it runs.
    """

    line: str
    suits: Requirement
    designs: Callable[[], Mapping[str, MakeDesign]]
    alias: str | None = None
    smooth: bool = True
    stable: bool = True
    learns: bool = False

    def make(self, name: str, machine: "Machine", flags: "Controlled") -> "Design":
        """Design of this name for the machine."""
        found = self.designs()[name](name, self.line, machine, flags)
        return replace(found, learns=self.learns)


class ConstrainedEntry(NamedTuple):
    """A controller on the host that solves a QP at every sample.

    Attributes:
        command: that runs it.
        line: description in one line.
        why: a command of its own.
    """

    command: str
    line: str
    why: str


class ContourEntry(NamedTuple):
    """A built-in contour or axis move.

    Attributes:
        line: description in one line.
        tasks: makers of the tasks of this kind by name, imported when called.
    """

    line: str
    tasks: Callable[[], Mapping[str, Callable[["Pace"], "Task"]]]

    def make(self, name: str, pace: "Pace") -> "Task":
        """Task of this name for the pace."""
        return self.tasks()[name](pace)

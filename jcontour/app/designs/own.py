"""Controllers that describe themselves without a design of their own.

Their weights are their own fields that are floats. Class attributes may say more:

    weights = (Weight("gain", "A/m", Interval(1.0, 1e4)),)     instead of a positive number
    needs = Needs("a machine of two axes", also=lambda machine: len(machine.axes) == 2)
"""

import inspect
from typing import Any

import equinox as eqx
import numpy as np

from jcontour.app.designs.design import Design, Gains, Needs, first_line
from jcontour.app.flags.shared import Controlled
from jcontour.app.machines.machine import Machine
from jcontour.controller import Controller
from jcontour.linear.plant import LinearPlant
from tuning.parameters import Weight


def own_design(name: str, thing: Any, machine: Machine, flags: Controlled) -> Design:
    """Design of a `Controller` class of the catalogue, described by its first line.

    Raises:
        ValueError: a flag or a weight is wrong.
    """
    controller = made(thing, machine.model, flags.preview)
    return OwnDesign(name, first_line(thing), controller, machine, flags)


def made(thing: Any, model: LinearPlant, preview: int) -> Any:
    """Controller of a class, with `for_model` or without arguments, or of a function of the model.

    Both may take the preview as well.
    """
    make = getattr(thing, "for_model", thing)
    if make is thing and inspect.isclass(thing):
        return thing()
    takes = inspect.signature(make).parameters
    return make(model, preview=preview) if "preview" in takes else make(model)


class OwnDesign(Design[Machine]):
    """A controller that somebody has made for a machine.

    Raises:
        ValueError: what the class says is of no such field.
    """

    needs = Needs("a machine that it is made for")

    def __init__(
        self, name: str, line: str, controller: Controller, machine: Machine, flags: Controlled
    ):
        self.line, self.controller = line, controller
        self.reads = ("preview",) if controller.preview == flags.preview else ()
        values = _fields(controller)
        said = {one.name: one for one in getattr(controller, "weights", ())}
        unknown = [field for field in said if field not in values]
        if unknown:
            raise ValueError(
                f"{name}: weights: there is no weight {unknown[0]!r}; known are {', '.join(values)}"
            )
        self.weights = tuple(
            said.get(field, Weight(field))._replace(start=value) for field, value in values.items()
        )
        super().__init__(name, machine, flags)

    def build(self, weights: Gains) -> Controller:
        names = list(weights)
        if not names:
            return self.controller
        values = [weights[name] for name in names]
        return eqx.tree_at(
            lambda one: [getattr(one, name) for name in names], self.controller, values
        )

    def first_preview(self, first: Gains) -> int:
        return self.controller.preview


def _fields(controller: Controller) -> Gains:
    """Its fields that are finite floats, one or several in a row."""
    found = {}
    for name, field in type(controller).__dataclass_fields__.items():
        value = getattr(controller, name)
        if field.metadata.get("static") or not eqx.is_inexact_array_like(value):
            continue
        if np.ndim(value) <= 1 and np.all(np.isfinite(value)):  # a limit may be infinite
            found[name] = value
    return found

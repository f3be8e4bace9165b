"""Entries of the catalogue: a name is the key, a line describes the thing.

Where it is made is said in words, `module:name`, and imported when the thing is asked for.
"""

from importlib import import_module
from typing import Any, NamedTuple


class Entry(NamedTuple):
    """A thing with a name.

    Attributes:
        line: description in one line.
        place: `module:name` of what makes it.
    """

    line: str
    place: str

    def load(self) -> Any:
        """Maker of the thing, or a table of makers."""
        return loaded(self.place)

    def __call__(self) -> Any:
        """The thing itself."""
        return self.load()()


def loaded(place: str) -> Any:
    """The thing that `module:name` names."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


# tables of makers by name
CONTOUR, MOVE = "jcontour.app.jobs.contours:BUILT_IN", "jcontour.app.jobs.motions:BUILT_IN"
BEAM = "a tenth of a metre around {} m on the gantry's beam"
CONTOURS = {
    "circle": Entry("circle of 1 mm radius", CONTOUR),
    "square": Entry("square of 2 mm, with sharp corners", CONTOUR),
    "ellipse": Entry("ellipse of 6 x 3 mm", CONTOUR),
    "lemniscate": Entry("figure of eight 6 mm wide, crosses itself", CONTOUR),
    "wave": Entry("cubic spline through five points, open", CONTOUR),
    "bracket": Entry("bracket with fillets, holes and a slot, 12 x 8 mm, G-code", CONTOUR),
    "cam": Entry("cam profile of a few hundred segments and arcs, G-code", CONTOUR),
    "lobes": Entry("four lobes of 30 +- 10 mm with tight curves, as Lam's", CONTOUR),
    "ring": Entry("circle of 25 mm radius, for flexible axes", CONTOUR),
    "rounded-square": Entry("spline of 50 mm, for flexible axes", CONTOUR),
    "ring-left": Entry(BEAM.format(-0.55), CONTOUR),
    "ring-centre": Entry(BEAM.format(0), CONTOUR),
    "cushion-left": Entry(BEAM.format(-0.3), CONTOUR),
    "oval-centre": Entry(BEAM.format(0.05), CONTOUR),
    "cushion-right": Entry(BEAM.format(0.4), CONTOUR),
    "eight-right": Entry(BEAM.format(0.7), CONTOUR),
    "task-a": Entry("point to point, trapezoidal (Yuan)", MOVE),
    "task-b": Entry("to and fro along a cosine (Yuan)", MOVE),
    "s-curve": Entry("point to point with limited jerk", MOVE),
}


MACHINES = {
    "bridgeport": Entry(
        "X-Y table of a machining centre, 8 states, 0.5 ms (McNab & Tsao)",
        "jcontour.app.machines.linear:bridgeport_machine",
    ),
    "xy-table": Entry(
        "X-Y table on lead screws with Coulomb friction, 8 states, 1 ms (Lam)",
        "jcontour.app.machines.xy_table:xy_table_machine",
    ),
    "emps": Entry(
        "X-Y table of two EMPS drives, 4 states, 1 ms, without their dry friction (Janot et al.)",
        "jcontour.app.machines.emps:emps_machine",
    ),
    "flexible-axis": Entry(
        "linear motor, spring and end effector, stick and slip, cogging (Yuan); tuned on its twin",
        "jcontour.app.machines.flexible_axis:thesis_machine",
    ),
    "flexible-axes": Entry(
        "two different flexible axes at right angles",
        "jcontour.app.machines.flexible_axis:biaxial_machine",
    ),
    "gantry": Entry(
        "head on a beam that twists between its two drives (Yuan)",
        "jcontour.app.machines.gantry:gantry_machine",
    ),
    "gantry-friction": Entry(
        "the same with stick and slip in its three guide ways; tuned on its twin",
        "jcontour.app.machines.gantry:friction_gantry_machine",
    ),
}

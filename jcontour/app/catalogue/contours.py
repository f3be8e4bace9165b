"""Contours and axis moves by name."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING

from jcontour.app.catalogue.entries import ContourEntry

if TYPE_CHECKING:
    from jcontour.app.jobs.job import Pace, Task


@cache
def _contours() -> Mapping[str, Callable[["Pace"], "Task"]]:
    from jcontour.app.jobs.contours import BUILT_IN

    return BUILT_IN


@cache
def _moves() -> Mapping[str, Callable[["Pace"], "Task"]]:
    from jcontour.app.jobs.motions import BUILT_IN

    return BUILT_IN


def _contour(line: str) -> ContourEntry:
    return ContourEntry(line, _contours)


def _along_the_beam(x: float) -> ContourEntry:
    return _contour(f"a tenth of a metre around {x:g} m on the gantry's beam")


CONTOURS = {
    "circle": _contour("circle of 1 mm radius"),
    "square": _contour("square of 2 mm, with sharp corners"),
    "ellipse": _contour("ellipse of 6 x 3 mm"),
    "lemniscate": _contour("figure of eight 6 mm wide, crosses itself"),
    "wave": _contour("cubic spline through five points, open"),
    "bracket": _contour("bracket with fillets, holes and a slot, 12 x 8 mm, G-code"),
    "cam": _contour("cam profile of a few hundred segments and arcs, G-code"),
    "lobes": _contour("four lobes of 30 +- 10 mm with tight curves, the kind of contour of Lam"),
    "ring": _contour("circle of 25 mm radius, for flexible axes"),
    "rounded-square": _contour("spline of 50 mm, for flexible axes"),
    "ring-left": _along_the_beam(-0.55),
    "ring-centre": _along_the_beam(0.0),
    "cushion-left": _along_the_beam(-0.3),
    "oval-centre": _along_the_beam(0.05),
    "cushion-right": _along_the_beam(0.4),
    "eight-right": _along_the_beam(0.7),
    "task-a": ContourEntry("point to point, trapezoidal (Yuan)", _moves),
    "task-b": ContourEntry("to and fro along a cosine (Yuan)", _moves),
    "s-curve": ContourEntry("point to point with limited jerk", _moves),
}

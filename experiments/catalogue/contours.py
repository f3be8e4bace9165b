"""Contours and motions by name."""

from experiments.catalogue.entries import Entry
from experiments.jobs import contours
from experiments.jobs.job import TOOLPATHS, at_constant_feed, from_file
from experiments.jobs.motions import s_curve, task_a, task_b
from jcontour.geometry.contours import circle, ellipse, lemniscate
from jcontour.geometry.periodic_splines import polar_lobes


def _along_the_beam(name: str, x: float, outline: contours.Outline) -> Entry:
    return Entry(
        contours.along_the_beam(name, x, outline),
        f"a tenth of a metre around {x:g} m on the gantry's beam",
        on="gantry",
    )


CONTOURS = {
    "circle": Entry(
        lambda pace: at_constant_feed("circle", circle(1e-3), pace),
        "circle of 1 mm radius, constant feed",
    ),
    "square": Entry(contours.square, "square of 2 mm, constant feed, corners and all"),
    "ellipse": Entry(
        lambda pace: at_constant_feed("ellipse", ellipse(3e-3, 1.5e-3), pace),
        "ellipse of 6 x 3 mm at constant feed",
    ),
    "lemniscate": Entry(
        lambda pace: at_constant_feed("lemniscate", lemniscate(3e-3), pace),
        "figure of eight 6 mm wide, crosses itself",
    ),
    "wave": Entry(contours.wave, "cubic spline through five points, open"),
    "bracket": Entry(
        lambda pace: from_file(TOOLPATHS / "bracket.ngc", pace),
        "bracket with fillets, holes and a slot, 12 x 8 mm, G-code",
    ),
    "cam": Entry(
        lambda pace: from_file(TOOLPATHS / "cam.ngc", pace),
        "cam profile of a few hundred segments and arcs, G-code",
    ),
    "lobes": Entry(
        lambda pace: at_constant_feed("lobes", polar_lobes(30e-3, 10e-3, 4), pace),
        "four lobes of 30 +- 10 mm with tight curves, the kind of contour of Lam",
    ),
    "ring": Entry(contours.ring, "circle of 25 mm radius, for flexible axes", on="flexible-axes"),
    "rounded-square": Entry(
        contours.rounded_square, "spline of 50 mm, for flexible axes", on="flexible-axes"
    ),
    "ring-left": _along_the_beam("ring-left", -0.55, contours.ring_outline),
    "ring-centre": _along_the_beam("ring-centre", 0.0, contours.ring_outline),
    "cushion-left": _along_the_beam("cushion-left", -0.3, contours.cushion_outline),
    "oval-centre": _along_the_beam("oval-centre", 0.05, contours.oval_outline),
    "cushion-right": _along_the_beam("cushion-right", 0.4, contours.cushion_outline),
    "eight-right": _along_the_beam("eight-right", 0.7, contours.eight_outline),
    "task-a": Entry(task_a, "point to point, trapezoidal (Yuan)", on="flexible-axis"),
    "task-b": Entry(task_b, "to and fro along a cosine (Yuan)", on="flexible-axis"),
    "s-curve": Entry(s_curve, "point to point with limited jerk", on="flexible-axis"),
}

"""Contours and axis moves by name."""

from jcontour.app.catalogue.entries import Entry

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

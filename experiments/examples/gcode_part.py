"""A part from G-code, at the feed that the machine's limits allow."""

from jcontour import feed_laws, references, score, simulate, toolpaths
from jcontour.controllers import ContouringLQ, LQWeights
from jcontour.plants import bridgeport

PROGRAM = """
G21 G90 F3000           (millimetres, absolute, 3 m/min)
G0 X0 Y0
G1 X10                  (a slot with round ends)
G3 X10 Y4 I0 J2
G1 X0
G3 X0 Y0 I0 J-2
M30
"""

machine = bridgeport()
part = toolpaths.parse_gcode(PROGRAM)  # or read_gcode("part.ngc")
arc = feed_laws.trapezoidal(part.contour, part.feed, machine.dt, acceleration=1.0)  # [m/s^2]
reference = references.along(part.contour, arc, machine.dt, preview=10, at_rest=True)

controller = ContouringLQ(machine, LQWeights(alpha=3.0, beta=5.0, rho=2e-9), preview=10)
metrics = score(simulate(machine, controller, reference), reference)
length, duration = float(part.contour.length), float(metrics.duration)
print(
    f"{1e3 * length:.2f} mm in {duration:.3f} s, with an RMS contour error of "
    f"{1e6 * metrics.rms_contour_error:.2f} um."
)

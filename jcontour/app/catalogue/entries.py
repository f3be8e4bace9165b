"""Entries of the catalogue: a name is the key, a line describes the thing.

Where it is made is said in words, `module:name`, and imported when the thing is asked for. A
newcomer writes a class that describes itself, a `Controller` with `for_model` or a `Design`, and
adds its name to `CONTROLLERS`.
"""

import ast
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[3]


class Entry(NamedTuple):
    """A thing with a name."""

    line: str  # description in one line
    place: str  # `module:name` of what makes it

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


CONTOUR = "jcontour.app.jobs.contours:BUILT_IN"  # table of makers by name
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
    "task-a": Entry("point to point, trapezoidal (Yuan)", CONTOUR),
    "task-b": Entry("to and fro along a cosine (Yuan)", CONTOUR),
    "s-curve": Entry("point to point with limited jerk", CONTOUR),
}


MACHINES = {
    "bridgeport": Entry(
        "X-Y table of a machining centre, 8 states, 0.5 ms (McNab & Tsao)",
        "jcontour.app.machines.linear:bridgeport_machine",
    ),
    "xy-table": Entry(
        "X-Y table on lead screws with Coulomb friction, 8 states, 1 ms (Lam)",
        "jcontour.app.machines.linear:xy_table_machine",
    ),
    "emps": Entry(
        "X-Y table of two EMPS drives, 4 states, 1 ms, without their dry friction (Janot et al.)",
        "jcontour.app.machines.linear:emps_machine",
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

# on the host, a quadratic program at every sample: `simulate` runs them, nothing is tuned of them
PREDICTIVE = "jcontour.app.designs.predictive:PREDICTIVE"
CONSTRAINED = {
    "mpcc": Entry("model predictive contouring control (Lam), chooses its own speed", PREDICTIVE),
    "tracking-mpc": Entry("tracking MPC at a constant speed (Lam's other one)", PREDICTIVE),
}
CONTROLLERS = {  # name -> module and class
    "contouring-lq": "jcontour.app.designs.receding_horizon:LQDesign",
    "contouring-lq-riccati": "jcontour.app.designs.receding_horizon:RiccatiLQ",
    "contouring-lq-zero": "jcontour.app.designs.receding_horizon:ZeroLQ",
    "cross-coupled-lq": "jcontour.app.designs.receding_horizon:CrossCoupledLQDesign",
    "contouring-lq-kalman": "jcontour.app.designs.receding_horizon:KalmanLQ",
    "contouring-lq-predictor": "jcontour.app.designs.receding_horizon:PredictorLQ",
    "contouring-lq-state": "jcontour.app.designs.receding_horizon:StateLQ",
    "contouring-lq-blocks": "jcontour.app.designs.receding_horizon:BlocksLQ",
    "constrained-lq": "jcontour.app.designs.limited:ConstrainedLQDesign",
    "preview-lq": "jcontour.app.designs.receding_horizon:PreviewLQDesign",
    "linear-cascade": "jcontour.app.designs.simple_loops:LinearCascade",
    "linear-cascade-feedforward": "jcontour.app.designs.simple_loops:ProportionalIntegralLoop",
    "linear-cascade-notch": "jcontour.app.designs.simple_loops:NotchedProportionalIntegralLoop",
    "position-loop": "jcontour.app.designs.simple_loops:ProportionalLoop",
    "position-loop-notch": "jcontour.app.designs.simple_loops:NotchedProportionalLoop",
    "zpetc": "jcontour.app.designs.inverse_feedforward:ZeroPhaseCascade",
    "causal-inverse": "jcontour.app.designs.inverse_feedforward:CausalCascade",
    "optimal-feedforward": "jcontour.app.designs.inverse_feedforward:OptimalCascade",
    "repetitive": "jcontour.app.designs.adaptive:RepetitiveCascade",
    "run-out": "jcontour.app.designs.adaptive:RunOutCascade",
    "adaptive-zpetc": "jcontour.app.designs.adaptive:AdaptiveZeroPhase",
    "cascade": "jcontour.app.designs.flexible_axis:AxisCascade",
    "cascade-feedforward": "jcontour.app.designs.flexible_axis:AxisFeedforward",
    "cascade-notch": "jcontour.app.designs.flexible_axis:AxisNotch",
    "cascade-low-pass": "jcontour.app.designs.flexible_axis:AxisLowPass",
    "cascade-leso": "jcontour.app.designs.flexible_axis:AxisRejection",
    "cascade-leso-exact": "jcontour.app.designs.flexible_axis:AxisExactRejection",
    "cascade-leso-euler": "jcontour.app.designs.flexible_axis:AxisEulerRejection",
    "cascade-dob": "jcontour.app.designs.flexible_axis:AxisDisturbanceObserver",
    "time-delay": "jcontour.app.designs.flexible_axis:AxisTimeDelay",
    "pole-placement": "jcontour.app.designs.flexible_axis:AxisPoles",
    "lqr": "jcontour.app.designs.flexible_axis:AxisLQ",
    "lqr-quasi-steady": "jcontour.app.designs.flexible_axis:AxisQuasiSteadyLQ",
    "cascade-zv": "jcontour.app.designs.flexible_axis:AxisShaped",
    "cascade-zvd": "jcontour.app.designs.flexible_axis:AxisFlatShaped",
    "cascade-ei": "jcontour.app.designs.flexible_axis:AxisInsensitiveShaped",
    "lqg": "jcontour.app.designs.flexible_axis:AxisLQG",
    "lqg-offset-free": "jcontour.app.designs.flexible_axis:AxisOffsetFreeLQG",
    "flexible-zpetc": "jcontour.app.designs.inverse_feedforward:AxisZeroPhase",
    "flexible-causal-inverse": "jcontour.app.designs.inverse_feedforward:AxisCausal",
    "flexible-optimal-feedforward": "jcontour.app.designs.inverse_feedforward:AxisOptimal",
    "gantry-cascade": "jcontour.app.designs.gantry:GantryCascade",
    "gantry-friction-cascade": "jcontour.app.designs.gantry:GantryFrictionCascade",
    "gantry-contouring-lq": "jcontour.app.designs.gantry:GantryLQ",
    "gantry-scheduled-lq": "jcontour.app.designs.gantry:GantryScheduledLQ",
    "gantry-feedback-linearised-lq": "jcontour.app.designs.gantry:GantryLinearisedLQ",
    "gantry-offset-free-lq": "jcontour.app.designs.gantry:GantryOffsetFreeLQ",
    "gantry-synchronised": "jcontour.app.designs.synchronised:SynchronisedDrives",
    "gantry-self-tuning": "jcontour.app.designs.gantry:GantrySelfTuning",
    "gantry-zpetc": "jcontour.app.designs.inverse_feedforward:GantryZeroPhase",
    "gantry-optimal-feedforward": "jcontour.app.designs.inverse_feedforward:GantryOptimal",
    "cross-coupled": "jcontour.app.designs.contouring_schemes:CrossCoupledCascade",
    "cross-coupled-variable": "jcontour.app.designs.contouring_schemes:VariablyCoupledCascade",
    "task-frame": "jcontour.app.designs.contouring_schemes:TaskFrameCascade",
    "precompensation": "jcontour.app.designs.contouring_schemes:PrecompensatedCascade",
    "command-shaping": "jcontour.app.designs.contouring_schemes:ShapedCascade",
    "synchronised": "jcontour.app.designs.synchronised:SynchronisedAxes",
    "master-slave": "jcontour.app.designs.synchronised:MasterSlaveDrives",
    "sliding-mode": "jcontour.app.designs.any_machine:BoundaryLayerSliding",
    "super-twisting": "jcontour.app.designs.any_machine:SuperTwistingSliding",
    "integral-sliding-mode": "jcontour.app.designs.any_machine:IntegralSliding",
    "reference-governor": "jcontour.app.designs.limited:ScalarGoverned",
    "command-governor": "jcontour.app.designs.limited:VectorGoverned",
    "artificial-reference-mpc": "jcontour.app.designs.limited:ArtificialReferenceDesign",
    "dynamic-surface": "jcontour.app.designs.any_machine:DynamicSurfaceLoops",
    "adaptive-robust": "jcontour.app.designs.any_machine:AdaptiveRobustLoops",
    "predictive-cascade": "jcontour.app.designs.any_machine:GeneralisedPredictiveCascade",
    "predictive-repetitive": "jcontour.app.designs.any_machine:RepeatedRegulator",
    "h-infinity": "jcontour.app.designs.any_machine:MixedSensitivity",
}
# of the names on some kinds of machines: `cascade` is `gantry-cascade` on a gantry
PREFIXES = ("gantry-friction-", "gantry-", "flexible-", "linear-")


def line_of(name: str) -> str:
    """First line of the docstring of a controller's class, read without importing it."""
    module, _, its = CONTROLLERS[name].partition(":")
    return _lines(ROOT.joinpath(*module.split(".")).with_suffix(".py"))[its]


@cache
def _lines(file: Path) -> dict[str, str]:
    """Class -> first line of its docstring."""
    return {
        node.name: (ast.get_docstring(node) or "").partition("\n")[0].rstrip(".")
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
    }


def design_class(name: str) -> type:
    """Class of a controller of the list, imported when it is asked for."""
    return loaded(CONTROLLERS[name])

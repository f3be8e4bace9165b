"""Controllers by name, for the command line and for the contract tests.

A newcomer writes a class that describes itself, a `Controller` with `for_model` or a `Design`, and
adds its name here.
"""

import ast
from functools import cache
from pathlib import Path
from typing import NamedTuple

from jcontour.app.catalogue.entries import loaded

ROOT = Path(__file__).parents[3]


class Constrained(NamedTuple):
    """A controller on the host that solves a QP at every sample.

    Attributes:
        command: that runs it.
        line: description in one line.
        why: a command of its own.
    """

    command: str
    line: str
    why: str


CONSTRAINED = {
    "mpcc": Constrained(
        "simulate",
        "model predictive contouring control (Lam), chooses its own speed",
        "chooses its own speed, nothing is tuned of it",
    ),
    "tracking-mpc": Constrained(
        "simulate",
        "tracking MPC at a constant speed (Lam's other one)",
        "is compared by its horizon and speed, nothing is tuned of it",
    ),
    "bounded-mpc": Constrained(
        "tolerance",
        "predictive control that never leaves a tolerance (Yuan): `jcontour tolerance`",
        "keeps what is proven, nothing is tuned of it",
    ),
}
PREDICTIVE = ("mpcc", "tracking-mpc")  # of these, what `simulate` runs
CONTROLLERS = {  # name -> module and class
    "contouring-lq": "jcontour.app.designs.lq.receding_horizon:LQDesign",
    "contouring-lq-riccati": "jcontour.app.designs.lq.receding_horizon:RiccatiLQ",
    "contouring-lq-zero": "jcontour.app.designs.lq.receding_horizon:ZeroLQ",
    "cross-coupled-lq": "jcontour.app.designs.lq.receding_horizon:CrossCoupledLQDesign",
    "contouring-lq-kalman": "jcontour.app.designs.lq.receding_horizon:KalmanLQ",
    "contouring-lq-predictor": "jcontour.app.designs.lq.receding_horizon:PredictorLQ",
    "contouring-lq-state": "jcontour.app.designs.lq.receding_horizon:StateLQ",
    "contouring-lq-riccati-state": "jcontour.app.designs.lq.receding_horizon:RiccatiStateLQ",
    "contouring-lq-blocks": "jcontour.app.designs.lq.receding_horizon:BlocksLQ",
    "constrained-lq": "jcontour.app.designs.lq.constrained_lq:ConstrainedLQDesign",
    "preview-lq": "jcontour.app.designs.lq.receding_horizon:PreviewLQDesign",
    "preview-lq-state": "jcontour.app.designs.lq.receding_horizon:PreviewStateLQ",
    "linear-cascade": "jcontour.app.designs.feedforward:LinearCascade",
    "linear-cascade-feedforward": "jcontour.app.designs.simple_loops:ProportionalIntegralLoop",
    "linear-cascade-notch": "jcontour.app.designs.simple_loops:NotchedProportionalIntegralLoop",
    "position-loop": "jcontour.app.designs.simple_loops:ProportionalLoop",
    "position-loop-notch": "jcontour.app.designs.simple_loops:NotchedProportionalLoop",
    "zpetc": "jcontour.app.designs.feedforward:ZeroPhaseCascade",
    "causal-inverse": "jcontour.app.designs.feedforward:CausalCascade",
    "optimal-feedforward": "jcontour.app.designs.feedforward:OptimalCascade",
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
    "cascade-nleso": "jcontour.app.designs.flexible_axis:AxisNonlinearRejection",
    "cascade-dob": "jcontour.app.designs.flexible_axis:AxisDisturbanceObserver",
    "time-delay": "jcontour.app.designs.flexible_axis:AxisTimeDelay",
    "pole-placement": "jcontour.app.designs.flexible_axis:AxisPoles",
    "lqr": "jcontour.app.designs.flexible_axis:AxisLQ",
    "lqr-quasi-steady": "jcontour.app.designs.flexible_axis:AxisQuasiSteadyLQ",
    "cascade-zv": "jcontour.app.designs.flexible_axis:AxisShaped",
    "lqg": "jcontour.app.designs.flexible_axis:AxisLQG",
    "lqg-offset-free": "jcontour.app.designs.flexible_axis:AxisOffsetFreeLQG",
    "flexible-zpetc": "jcontour.app.designs.motor_feedforward:AxisZeroPhase",
    "flexible-causal-inverse": "jcontour.app.designs.motor_feedforward:AxisCausal",
    "flexible-optimal-feedforward": "jcontour.app.designs.motor_feedforward:AxisOptimal",
    "gantry-cascade": "jcontour.app.designs.gantry:GantryCascade",
    "gantry-friction-cascade": "jcontour.app.designs.gantry:GantryFrictionCascade",
    "gantry-contouring-lq": "jcontour.app.designs.gantry:GantryLQ",
    "gantry-scheduled-lq": "jcontour.app.designs.gantry:GantryScheduledLQ",
    "gantry-feedback-linearised-lq": "jcontour.app.designs.gantry:GantryLinearisedLQ",
    "gantry-offset-free-lq": "jcontour.app.designs.gantry_observer:GantryOffsetFreeLQ",
    "gantry-synchronised": "jcontour.app.designs.synchronised:SynchronisedDrives",
    "gantry-self-tuning": "jcontour.app.designs.gantry:GantrySelfTuning",
    "gantry-zpetc": "jcontour.app.designs.motor_feedforward:GantryZeroPhase",
    "gantry-optimal-feedforward": "jcontour.app.designs.motor_feedforward:GantryOptimal",
    "cross-coupled": "jcontour.app.designs.contouring_schemes:CrossCoupledCascade",
    "cross-coupled-variable": "jcontour.app.designs.contouring_schemes:VariablyCoupledCascade",
    "task-frame": "jcontour.app.designs.contouring_schemes:TaskFrameCascade",
    "precompensation": "jcontour.app.designs.contouring_schemes:PrecompensatedCascade",
    "command-shaping": "jcontour.app.designs.contouring_schemes:ShapedCascade",
    "polar": "jcontour.app.designs.contouring_schemes:PolarCascade",
    "synchronised": "jcontour.app.designs.synchronised:SynchronisedAxes",
    "master-slave": "jcontour.app.designs.synchronised:MasterSlaveDrives",
    "sliding-mode": "jcontour.app.designs.state_laws:BoundaryLayerSliding",
    "super-twisting": "jcontour.app.designs.state_laws:SuperTwistingSliding",
    "integral-sliding-mode": "jcontour.app.designs.state_laws:IntegralSliding",
    "reference-governor": "jcontour.app.designs.governed:ScalarGoverned",
    "command-governor": "jcontour.app.designs.governed:VectorGoverned",
    "dynamic-surface": "jcontour.app.designs.motor_laws:DynamicSurfaceLoops",
    "adaptive-robust": "jcontour.app.designs.motor_laws:AdaptiveRobustLoops",
    "predictive-cascade": "jcontour.app.designs.motor_laws:GeneralisedPredictiveCascade",
    "predictive-repetitive": "jcontour.app.designs.state_laws:RepeatedRegulator",
    "h-infinity": "jcontour.app.designs.robust:MixedSensitivity",
}
# shorter names -> what they stand for, from the general to the particular: the last one that suits
ALIASES = {
    "cascade": ("linear-cascade", "gantry-cascade", "gantry-friction-cascade"),
    "cascade-feedforward": ("linear-cascade-feedforward",),
    "cascade-notch": ("linear-cascade-notch",),
    "zpetc": ("flexible-zpetc", "gantry-zpetc"),
    "causal-inverse": ("flexible-causal-inverse",),
    "optimal-feedforward": ("flexible-optimal-feedforward", "gantry-optimal-feedforward"),
    "contouring-lq": ("gantry-contouring-lq",),
    "scheduled-lq": ("gantry-scheduled-lq",),
    "feedback-linearised-lq": ("gantry-feedback-linearised-lq",),
    "offset-free-lq": ("gantry-offset-free-lq",),
    "synchronised": ("gantry-synchronised",),
    "self-tuning": ("gantry-self-tuning",),
}


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

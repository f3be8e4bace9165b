"""Controllers by name, for the command line and for the contract tests.

A newcomer adds one line here and its maker in `catalogue.designs`. Where several controllers of one
alias suit a machine the last one is meant: the list goes from the general to the particular.
"""

from jcontour.app.catalogue.designs import (
    contouring_scheme_designs,
    flexible_axis_designs,
    gantry_designs,
    linear_feedforward_designs,
    lq_designs,
)
from jcontour.app.catalogue.entries import ConstrainedEntry, ControllerEntry, Requirement
from jcontour.app.catalogue.machines import (
    FLEXIBLE_AXES,
    FLEXIBLE_AXIS,
    GANTRY,
    GANTRY_WITH_FRICTION,
    GANTRY_WITHOUT_FRICTION,
    LIMITED,
    LINEAR,
)


def _lq(line: str) -> ControllerEntry:
    return ControllerEntry(line, LINEAR, lq_designs)


def _linear_cascade(line: str, alias: str | None = None) -> ControllerEntry:
    return ControllerEntry(line, LINEAR, linear_feedforward_designs, alias)


def _on_axis(line: str, alias: str | None = None) -> ControllerEntry:
    return ControllerEntry(line, FLEXIBLE_AXIS, flexible_axis_designs, alias)


def _on_axes(line: str) -> ControllerEntry:
    return ControllerEntry(line, FLEXIBLE_AXES, contouring_scheme_designs)


def _on_gantry(line: str, alias: str, suits: Requirement = GANTRY) -> ControllerEntry:
    return ControllerEntry(line, suits, gantry_designs, alias)


def _learning(entry: ControllerEntry) -> ControllerEntry:
    return entry._replace(learns=True)


CONSTRAINED = {
    "mpcc": ConstrainedEntry(
        "trace",
        "model predictive contouring control (Lam), chooses its own speed: `jcontour trace`",
        "chooses its own speed, nothing is tuned of it",
    ),
    "tracking-mpc": ConstrainedEntry(
        "sweep",
        "tracking MPC at a constant speed (Lam's other one): `jcontour sweep`",
        "is compared by its horizon and speed, nothing is tuned of it",
    ),
    "bounded-mpc": ConstrainedEntry(
        "tolerance",
        "predictive control that never leaves a tolerance (Yuan): `jcontour tolerance`",
        "keeps what is proven, nothing is tuned of it",
    ),
}
CONTROLLERS = {
    "contouring-lq": _lq(
        "receding-horizon LQ contouring, offset-free observer; --terminal chooses its end"
    ),
    "contouring-lq-riccati": _lq("the same with the Riccati terminal"),
    "contouring-lq-kalman": _lq("the same with a Kalman filter that finds no load"),
    "contouring-lq-predictor": _lq("the same with the predictor form of the observer"),
    "contouring-lq-state": _lq("the same fed the true state"),
    "contouring-lq-riccati-state": _lq("Riccati terminal, fed the true state"),
    "contouring-lq-blocks": _lq(
        "the same, seeing 200 samples or more; its horizon moves on in blocks"
    ),
    "constrained-lq": ControllerEntry(
        "contouring LQ that keeps to the machine's limits: a quadratic program at every sample",
        LIMITED,
        lq_designs,
    ),
    "preview-lq": _lq(
        "finite-preview LQ tracking (Tomizuka & Whitney), offset-free observer; beta unused"
    ),
    "preview-lq-state": _lq("the same fed the true state"),
    "linear-cascade": _linear_cascade("P-PI cascade on encoders, speeds by difference", "cascade"),
    "linear-cascade-feedforward": _linear_cascade(
        "the same fed speed, acceleration and viscous friction", "cascade-feedforward"
    ),
    "linear-cascade-notch": _linear_cascade(
        "the same through a notch at the lowest resonance", "cascade-notch"
    ),
    "position-loop": _linear_cascade("proportional position loop, fed speed and acceleration"),
    "position-loop-notch": _linear_cascade("the same through a notch at the lowest resonance"),
    "zpetc": _linear_cascade("zero phase error tracking (Tomizuka) in front of the cascade"),
    "optimal-feedforward": _linear_cascade(
        "l1-optimal feedforward with preview (Alter & Tsao) in front of the cascade"
    ),
    "repetitive": _learning(
        _linear_cascade(
            "the cascade, and what repeats with a known period learned (Tomizuka, Tsao & Chew)"
        )
    ),
    "run-out": _learning(
        _linear_cascade("the cascade, and sinusoids of a known frequency that cancel")
    ),
    "adaptive-zpetc": _learning(
        _linear_cascade(
            "a position loop behind zero phase tracking that learns the loop (Smith & Lee)"
        )
    ),
    "cascade": _on_axis("P position loop around a PI velocity loop"),
    "cascade-feedforward": _on_axis(
        "P-PI cascade fed what the motion needs: speed, inertia, viscous and dry friction"
    ),
    "cascade-notch": _on_axis("P-PI cascade through a notch"),
    "cascade-low-pass": _on_axis("P-PI cascade through a low pass"),
    "cascade-leso": _on_axis("P-PI cascade with a linear extended state observer"),
    "cascade-leso-exact": _on_axis("the same, its observer one sample late under zero-order hold"),
    "cascade-leso-euler": _on_axis("the same by forward Euler"),
    "cascade-nleso": _on_axis("P-PI cascade with a nonlinear extended state observer"),
    "cascade-dob": _on_axis("P-PI cascade with a disturbance observer"),
    "time-delay": _on_axis("what acted a sample ago stands for the disturbance of now"),
    "pole-placement": _on_axis("state feedback by its poles, moving target, reduced observer"),
    "lqr": _on_axis("linear-quadratic state feedback, moving target, reduced observer"),
    "lqr-quasi-steady": _on_axis(
        "the same with the thesis's target, at rest wherever the reference is"
    ),
    "cascade-zv": _on_axis("P-PI cascade with feedforward behind a zero-vibration shaper"),
    "lqg": _on_axis("linear-quadratic state feedback, Kalman filter, integral action"),
    "lqg-offset-free": _on_axis(
        "linear-quadratic state feedback, Kalman filter that finds the load and cancels it"
    ),
    "flexible-zpetc": _on_axis(
        "zero phase error tracking in front of the cascade, dry friction fed forward", "zpetc"
    ),
    "flexible-optimal-feedforward": _on_axis(
        "l1-optimal feedforward with preview in front of the cascade, dry friction fed forward",
        "optimal-feedforward",
    ),
    "gantry-cascade": _on_gantry(
        "P-PI cascade of each motor, fed speed and acceleration", "cascade"
    ),
    "gantry-friction-cascade": _on_gantry(
        "P-PI cascade of each motor, fed speed, acceleration and dry friction",
        "cascade",
        GANTRY_WITH_FRICTION,
    ),
    "gantry-contouring-lq": _on_gantry(
        "contouring LQ on three motors, its model that of the beam's centre", "contouring-lq"
    ),
    "gantry-scheduled-lq": _on_gantry(
        "contouring LQ on three motors, its models those along the path", "scheduled-lq"
    ),
    "gantry-feedback-linearised-lq": _on_gantry(
        "the same, the coupling of head and beam cancelled by feedback (Yuan)",
        "feedback-linearised-lq",
    ),
    "gantry-offset-free-lq": _on_gantry(
        "contouring LQ on three motors, behind an observer that predicts and finds the load",
        "offset-free-lq",
    ),
    "gantry-synchronised": _learning(
        _on_gantry(
            "adaptive feedforward of each motor, both Y drives kept together (Tomizuka)",
            "synchronised",
        )
    ),
    "gantry-self-tuning": _learning(
        _on_gantry(
            "a servo of each motor that learns its input gain (Astrom & Wittenmark)",
            "self-tuning",
            GANTRY_WITHOUT_FRICTION,
        )
    ),
    "gantry-zpetc": _on_gantry(
        "zero phase error tracking in front of the cascades, model of the beam's centre", "zpetc"
    ),
    "gantry-optimal-feedforward": _on_gantry(
        "l1-optimal feedforward with preview in front of the cascades, the same model",
        "optimal-feedforward",
    ),
    "cross-coupled": _on_axes("P-PI cascades with Koren's cross-coupled control, constant gains"),
    "cross-coupled-variable": _on_axes("the same with variable gains (Koren & Lo)"),
    "task-frame": _on_axes("P-PI cascades, position gains along the path and across it"),
    "precompensation": _on_axes("P-PI cascades behind cross-coupled pre-compensation"),
    "command-shaping": _on_axes("P-PI cascades behind cross-coupled position command shaping"),
    "synchronised": _learning(
        _on_axes("adaptive feedforward of two axes kept together (Tomizuka)")
    ),
}

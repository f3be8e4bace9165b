"""What a record does not show, or contradicts, in words: each with what helps."""

import numpy as np
from jaxtyping import Float

from tuning.identification.linear import evidence
from tuning.identification.linear.found import FAIR, LinearAxis
from tuning.identification.linear.simplest import Simple

COLOURED = 0.1  # correlation of the errors that is said
COUPLED = 0.01  # part of the errors' variance
SATURATED = 1e-3  # part of the samples
POOR = 0.9  # part of the variance explained on held-out data below which nothing is said
RUBS = 0.8  # friction over the RMS command, beyond which it hides the motion
STANDS = 0.1  # part of a record at rest beside which dry friction is thought of
FOLLOWS = 0.999  # part of a position that a gain explains: the axis follows its command
RUNS_AWAY = 1.002  # largest pole: integrators are 1, found to less than that


def follows(command: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"]) -> str:
    """Why a record shows no dynamics where a gain alone explains its position; empty elsewhere."""
    alike = float(np.corrcoef(command, position)[0, 1] ** 2)
    if alike <= FOLLOWS:
        return ""
    return (
        f"a gain alone explains {100 * alike:.5g} % of the position, and the rest is none of "
        "the command's: the record is too slow or too coarse to show dynamics; record at the "
        "drive's own rate, in encoder counts"
    )


def unexplained(command: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"]) -> str:
    """Why a stable model does not explain an axis."""
    if said := follows(command, position):
        return said
    pole = evidence.fastest_growth(command, position)
    if pole > RUNS_AWAY:
        return (
            f"what fits is unstable, it grows by {100 * (pole - 1):.2g} % a sample without its "
            "loop; only axes that stand still by themselves are identified"
        )
    return (
        "the command does not explain the position; are the columns those of one axis? Otherwise "
        "record a livelier program: jcontour identify --excite. Where dry friction takes much of "
        "the command, its long moves (G-code) tell more than its sines"
    )


def rubs(command: Float[np.ndarray, " T"], simple: Simple | None) -> str:
    """Why dry friction hides how the command moves the axis; empty where it takes less of it."""
    size = float(np.sqrt(np.mean(command**2)))
    if simple is None or len(simple.fit.drag) < 2 or simple.fit.drag[0] < RUBS * size:
        return ""
    return (
        f"dry friction takes nearly all of the command, {size:.3g} RMS: what is left is too little "
        "to show how it moves the axis; record moves of larger acceleration, as the long ones "
        "(G-code) of jcontour identify --excite"
    )


def beside(simple: Simple | None) -> str:
    """What the simple models explain, where they too explain little."""
    if simple is None or simple.explained <= 0:
        return ""
    kind = "a mass with friction" if len(simple.fit.drag) else "a gain with a delay"
    return f". {kind} explains {100 * simple.explained:.3g} % of the speed there"


def doubt(explained: float, dispersion: float, stands: float, friction: bool) -> str:
    """Why a model that explains little of the speed is no use; empty where noise may be why."""
    held = stands > STANDS and not friction
    if explained >= POOR or not (dispersion > 1 or held):
        return ""
    why = f"the axis stands still for {100 * stands:.3g} % of the record"
    why = "noise is not the reason" if dispersion > 1 else why
    return (
        f"DO NOT USE: the model explains {100 * explained:.3g} % of the speed that it was not "
        f"fitted to, and {why}. Does dry (Coulomb) friction hold it? Its sines then tell little: "
        "record the long moves (G-code) of jcontour identify --excite alone, or moves that hardly "
        "rest, or try --most-order 2. Or does the drive clip the command at a limit that the log "
        "does not have? Then give what is left of it"
    )


def notes(axis: LinearAxis) -> list[str]:
    """Doubts about one axis, one line each."""
    notes, name = [], axis.name
    if axis.fit.model.numerator.sum() * (1 + axis.fit.model.denominator.sum()) < 0:
        notes.append(
            f"{name}: a positive command moves it backwards: is the command or the encoder "
            "reversed? What is tuned on the file takes it as it is"
        )
    if axis.explained < FAIR:
        notes.append(
            f"{name}: simulated from the command alone, explains {100 * axis.explained:.1f} % of "
            "the speed that it was not fitted to; of a quiet drive more than 99 %"
        )
    if axis.unseen:
        shown = _up_to(axis.response.band[1])
        words = f"the response is known to 10 % {shown}; the record does not show whether the "
        words += "axis rings above that. There"
        notes.append(
            f"{name}: {words} a resonance may be hidden that answers {evidence.HIDDEN:g} times as "
            "much: tune recommends no loop whose complementary sensitivity exceeds "
            f"{1 / evidence.HIDDEN:g} there. The delay may stand for what is faster: "
            f"{_advice(axis)}"
        )
    if axis.friction is not None:
        value, deviation = axis.friction
        notes.append(
            f"{name}: dry friction takes {value:.4g} of the command (+- {2 * deviation:.2g}); the "
            "model is what is left without it"
        )
    if axis.dispersion > 1:
        notes.append(
            f"{name}: something acts that no linear model with this friction has: it pulls at the "
            f"model {axis.dispersion:.3g} times as much as noise. The intervals allow for it"
        )
    if axis.hides_friction:
        notes.append(
            f"{name}: if it is dry friction, it could not be separated, and the file does not "
            "state it: record long moves"
        )
    if axis.saturated > SATURATED:
        notes.append(
            f"{name}: for {100 * axis.saturated:.1f} % of the record the command stands at an "
            "extreme; if that is its limit, what was recorded is not what the drive asked for"
        )
    for other, part in axis.coupling.items():
        if part > COUPLED:
            notes.append(
                f"{name}: the command of {other} explains {100 * part:.1f} % of what the model "
                "leaves; the machine file has no coupling"
            )
    worst = float(np.abs(evidence.correlations(axis.fit)).max())
    if worst > COLOURED:
        notes.append(
            f"{name}: neighbouring errors are correlated ({worst:.2f}): something acts that no "
            "linear model of this order has; the intervals allow for it"
        )
    return notes


def _advice(axis: LinearAxis) -> str:
    """What to run next: dry friction is told by moves, as it holds an axis through small sines."""
    words = "run what jcontour identify --excite writes"
    if axis.friction is not None or axis.hides_friction:
        words += (
            ", its sines and then its moves in one log; dry friction holds the axis through small "
            "sines, and is told by the moves"
        )
    return (
        f"{words}. If this record is of those sines, they hardly arrive, as behind a slow position "
        "loop: raise the gain of that loop, give larger sines, or command the drive directly"
    )


def _up_to(hertz: float) -> str:
    return f"up to {hertz:.3g} Hz" if np.isfinite(hertz) else "nowhere within 10 %"

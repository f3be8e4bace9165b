"""What a record does not show, contradicts or limits, in words: each with what helps."""

import numpy as np
from jaxtyping import Float

from tuning.identification.linear import validation
from tuning.identification.linear.identified_axes import FAIR, IdentifiedAxis
from tuning.identification.linear.output_error import TRAINING
from tuning.identification.linear.rigid_axis import Simple, part_explained

COLOURED = 0.1  # correlation of the errors that is said
COUPLED = 0.01  # part of the errors' variance
SATURATED = 1e-3  # part of the samples
POOR = 0.9  # part of the variance explained on held-out data below which nothing is said
CAUSE = 0.5  # part of the speed that a cause explains, if it is said
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


def unexplained(
    command: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"], related: bool
) -> str:
    """Why a stable model does not explain an axis whose signals are `related`, or not."""
    if said := follows(command, position):
        return said
    pole = validation.fastest_growth(command, position)
    if pole > RUNS_AWAY:
        return (
            f"what fits is unstable, it grows by {100 * (pole - 1):.2g} % a sample without its "
            "loop; only axes that stand still by themselves are identified"
        )
    doubt = "are the columns those of one axis?"
    if related:
        doubt = (
            "though the two are related: does a feedforward act that the log does not have, or a "
            "force that depends on the place, as gravity on an arm?"
        )
    return (
        f"the command does not explain the position; {doubt} Otherwise "
        "record a livelier program: jcontour identify --excite. Where dry friction takes much of "
        "the command, its long moves (G-code) tell more than its sines"
    )


def friction_hides(command: Float[np.ndarray, " T"], simple: Simple | None) -> str:
    """Why dry friction hides how the command moves the axis; empty where it takes less of it."""
    size = float(np.sqrt(np.mean(command**2)))
    if simple is None or len(simple.fit.drag) < 2 or simple.explained < CAUSE:
        return ""
    if simple.fit.drag[0] < RUBS * size:
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


def unusable(explained: float, dispersion: float, stands: float, friction: bool) -> str:
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


def notes(axis: IdentifiedAxis) -> list[str]:
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
        last = axis.response.band[1]
        shown = f"up to {last:.3g} Hz" if np.isfinite(last) else "nowhere"
        words = f"the response is known to 10 % {shown}; the record does not show whether the "
        words += f"axis rings {'above that' if last > 0 else 'at all'}. There"
        notes.append(
            f"{name}: {words} a resonance may be hidden that answers {validation.HIDDEN:g} times "
            "as much: tune recommends no loop whose complementary sensitivity exceeds "
            f"{1 / validation.HIDDEN:g} there. The delay may stand for what is faster: "
            f"{_advice(axis)}"
        )
    if axis.friction is not None and not axis.fit.model.integrators:
        gain = abs(axis.fit.model.numerator.sum() / (1 + axis.fit.model.denominator.sum()))
        late, deviation = (2e6 * gain * one for one in axis.friction)
        notes.append(
            f"{name}: turns about late by {late:.3g} um (+- {2 * deviation:.2g}): dry friction "
            "behind a position loop without an integrator, or backlash; positions do not tell them "
            "apart, and the file has it as friction"
        )
    elif axis.friction is not None:
        value, deviation = axis.friction
        notes.append(
            f"{name}: dry friction takes {value:.4g} of the command (+- {2 * deviation:.2g})"
            f"{_breaking_away(axis)}; the model is what is left without it"
        )
    if axis.dispersion > 1:
        notes.append(
            f"{name}: something acts that this model lacks, as a resonance or other friction: it "
            f"pulls at the model {axis.dispersion:.3g} times as much as noise; the intervals allow "
            "for it"
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
    worst = float(np.abs(validation.correlations(axis.fit)).max())
    if worst > COLOURED:
        notes.append(
            f"{name}: neighbouring errors are correlated ({worst:.2f}): something acts that no "
            "linear model of this order has; the intervals allow for it"
        )
    return notes


def _breaking_away(axis: IdentifiedAxis) -> str:
    """How much more it takes at rest, where that is seen."""
    if axis.stribeck is None:
        return ""
    more, speed = axis.stribeck
    return f", about {more:.2g} more at rest, half of that at {1e3 * speed:.2g} mm/s"


def _advice(axis: IdentifiedAxis) -> str:
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


AT_REST = 0.02  # of the squared speed
TOP = 99.0  # percentile of the speed that counts as the largest
MORE = 1.15  # times the largest speed, that a command asks for
OFTEN = 0.02  # of the samples
SPAN = 8  # samples over which a speed is taken
LEVELS = np.linspace(0.2, 0.95, 16)  # of the largest command, at which it may be cut
FAST, MOSTLY = 0.8, 0.5  # of half the rate; of the power
SURE = 0.3  # of what is left without a cut


def limits_of(
    command: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"], dt: float
) -> str:
    """A sentence about a limit that keeps a linear model from explaining a record; else empty.

    Args:
        command: of the drive.
        position: [m].
        dt: sample period [s].
    """
    return (
        _at_rest(position, dt)
        or _aliased(command)
        or _speed_limit(command, position, dt)
        or _command_limit(command, position)
    )


def _at_rest(position: np.ndarray, dt: float) -> str:
    """Of an axis that moves at the beginning alone."""
    speed = np.diff(position)
    power = np.cumsum(speed**2)
    judged = power[-1] - power[int(TRAINING * len(power))]
    if judged > AT_REST * power[-1]:
        return ""
    ends = dt * float(np.searchsorted(power, (1 - AT_REST) * power[-1]))
    return (
        f"the axis moves for the first {ends:.3g} s of {dt * len(position):.3g} s alone, and its "
        f"model is judged by the last {100 * (1 - TRAINING):.0f} %: record moves all along, "
        "or give a step response to jcontour machine --steps"
    )


def _aliased(command: np.ndarray) -> str:
    """Of a command that is mostly near half the rate of the log."""
    power = np.abs(np.fft.rfft(command - command.mean())) ** 2
    fast = float(power[int(FAST * len(power)) :].sum() / max(power.sum(), 1e-300))
    if fast < MOSTLY:
        return ""
    return (
        f"{100 * fast:.0f} % of the command's power is near half the rate of the log: it changes "
        "from sample to sample, faster than the log tells (aliasing); record at a higher rate"
    )


def _speed_limit(command: np.ndarray, position: np.ndarray, dt: float) -> str:
    """Of a drive that takes a position, and is asked for more speed than it ever has."""
    u = command - command.mean()
    wanted = u * float(u @ position) / float(u @ u) + position.mean()
    asked = np.abs(np.gradient(wanted, dt))
    largest = float(np.percentile(np.abs(np.gradient(position, dt)), TOP))
    beyond = np.flatnonzero(asked > MORE * largest)
    if len(beyond) < OFTEN * len(asked):
        return ""
    place, limited, step = float(position[0]), [], largest * dt
    for one in wanted.tolist():
        place += min(max(one - place, -step), step)
        limited.append(place)
    if part_explained(position, np.array(limited)) < CAUSE:
        return ""
    return (
        f"the command asks for up to {60e3 * asked[beyond].max():.4g} mm/min, first after "
        f"{dt * beyond[0]:.3g} s, and the axis goes no faster than {60e3 * largest:.4g} mm/min: "
        "its drive limits the speed, which no linear model has; use what is before, or ask for less"
    )


def _command_limit(command: np.ndarray, position: np.ndarray) -> str:
    """By the speed over spans, v(k+1) = a v(k) + b u(k) + b' u(k-1), of commands that are cut."""
    if len(command) < 10 * SPAN:
        return ""
    speed = position[SPAN:] - position[:-SPAN]
    kernel = np.full(SPAN, 1 / SPAN)

    def left(level: float) -> float:
        u = np.convolve(np.clip(command, -level, level), kernel, "valid")[: len(speed)]
        now, before = slice(SPAN, -SPAN), slice(0, -2 * SPAN)
        columns = np.stack([speed[now], u[2 * SPAN :], u[now], u[before]], axis=1)
        columns = np.append(columns, np.ones((len(columns), 1)), axis=1)
        right = speed[2 * SPAN :]
        found, *_ = np.linalg.lstsq(columns, right, rcond=None)
        return float(np.mean((right - columns @ found) ** 2))

    largest = float(np.abs(command).max())
    cut = [left(largest * part) for part in LEVELS]
    best = int(np.argmin(cut))
    if cut[best] > SURE * left(largest):
        return ""
    return (
        f"the axis answers as if its command were cut at about {largest * LEVELS[best]:.3g}, and "
        f"the log has it up to {largest:.3g}: log what is left of it, or ask for less"
    )

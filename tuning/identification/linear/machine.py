"""A machine of two or three axes from one record of all of them.

Each axis by itself: structure by `order_search`, numbers and intervals on the whole record,
friction where it is seen (`friction`). Then what the record cannot answer, in words, and the
family: every gain within the largest of what the intervals say, what two halves of the record
disagree by, and what drives repeat to; and one sample of delay more where the data do not tell the
model from one that answers half a sample later. The intervals of the response hold the models of
all delays that are not told apart, each fitted by itself; those of the richer models that the
record makes likelier without showing them clearly; and those of a model that is late by a part of a
sample, as no delay is known to be of whole ones. The gain does not, as it is one number for all
frequencies; it is taken where these intervals are narrow.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag
from scipy.stats import f as f_distribution

from jcontour.linear.plant import LinearPlant
from tuning.identification.estimates import Estimate
from tuning.identification.linear import evidence
from tuning.identification.linear.encoder_noise import encoder_noise
from tuning.identification.linear.friction import FAIR, friction_of, with_or_without_friction
from tuning.identification.linear.gain_uncertainty import LEAST_GAIN, gain_uncertainty
from tuning.identification.linear.held_response import held_response, own_response
from tuning.identification.linear.hidden_modes import lasting_hidden_mode
from tuning.identification.linear.order_search import (
    TELLS,
    Choice,
    Settled,
    held_out,
    of_fewer_poles,
    settled,
    with_part,
)
from tuning.identification.linear.output_error import AxisFit, AxisRecord
from tuning.identification.linear.rivals import lag, may_ring_to, rivals_of

FEWEST = 500  # samples
COLOURED = 0.1  # correlation of the errors that is said
COUPLED = 0.01  # part of the errors' variance
LEVEL = 1e-6  # of the F test for coupling
SATURATED = 1e-3  # part of the samples
POOR = 0.9  # part of the variance explained on held-out data below which nothing is said
STANDS = 0.1  # part of a record at rest beside which dry friction is thought of
LATE = 0.5  # samples: half of the one that the family has more
RUNS_AWAY = 1.002  # largest pole: integrators are 1, found to less than that


@dataclass(frozen=True)
class MachineRecord:
    """Commands and positions of all axes.

    Attributes:
        dt: sample period [s].
        axes: names.
        command: (T, axes) [command unit].
        position: (T, axes) [m].
    """

    dt: float
    axes: tuple[str, ...]
    command: Float[np.ndarray, "T axes"]
    position: Float[np.ndarray, "T axes"]


@dataclass(frozen=True)
class LinearAxis:
    """One identified axis.

    Attributes:
        name: of the axis.
        fit: model on the whole record.
        estimate: of its coefficients.
        response: with intervals.
        choice: structures that were compared.
        rivals: by how much the logarithm of the likelihood is less with another delay.
        held_out: position that the model of the first part gives for the rest [m].
        explained: part of the variance of the held-out speed that it explains.
        friction: command that Coulomb friction takes, and its standard deviation; None if not seen.
        offset: constant command that acts beside the given one while the axis moves; told where
            friction holds the axis at times, else 0.
        saturated: part of the samples at an extreme command.
        coupling: part of the errors that another axis explains, by its name; 0 if by chance.
        gain: relative uncertainty.
        gain_by: what it comes from, in words.
        dispersion: by how much more than noise the errors pull at the model; 1 if by chance.
        late: further samples of delay that the data allow, 0 or 1.
        resolution: of the encoder [m].
        encoder_noise: standard deviation of the encoder beside its rounding [m]; 0 if not sure.
        cancelled: poles of a likelier model that has a hidden mode; None if none.
    """

    name: str
    fit: AxisFit
    estimate: Estimate
    response: evidence.Response
    choice: Choice
    rivals: dict[int, float]
    held_out: Float[np.ndarray, " R"]
    explained: float
    friction: tuple[float, float] | None
    offset: float
    saturated: float
    coupling: dict[str, float]
    gain: float
    gain_by: str
    dispersion: float
    late: int
    resolution: float
    encoder_noise: float
    cancelled: int | None = None

    @property
    def hides_friction(self) -> bool:
        """Whether something acts that may be dry friction, and no number for it is sure."""
        return self.friction is None and self.dispersion > 1 and self.explained < FAIR

    @property
    def unseen(self) -> bool:
        """Whether the record hides how the axis answers where it may ring: it is said, with advice.

        A richer model is likelier without being shown clearly, or the response is known to 10 % up
        to a low frequency only.
        """
        reach = may_ring_to(self.fit.model.dt)
        return bool(self.choice.richer) or not self.response.band[1] >= reach

    @property
    def delays(self) -> list[int]:
        """Other delays that the record does not exclude [samples]."""
        return sorted(d for d, value in self.rivals.items() if value < TELLS)


@dataclass(frozen=True)
class LinearMachineFound:
    """What a record says about a machine.

    Attributes:
        record: it was found from.
        axes: one model each.
        notes: what the data do not show, or contradict.
    """

    record: MachineRecord
    axes: list[LinearAxis]
    notes: list[str]

    @property
    def known_delay(self) -> int:
        """Samples of delay that all axes share."""
        return min(one.fit.model.delay for one in self.axes)

    def plant(self) -> LinearPlant:
        """Model of all axes side by side, without the delay that they share."""
        shared = self.known_delay
        parts = [one.fit.model.realisation(one.fit.model.delay - shared) for one in self.axes]
        A, B, C = (block_diag(*matrices) for matrices in zip(*parts, strict=True))
        return LinearPlant(A, B, C, self.record.dt)

    def twice(self, name: str) -> "LinearMachineFound":
        """A machine of two such axes, from a record of one."""
        record, one = self.record, self.axes[0]
        both = replace(
            record,
            axes=(one.name, name),
            command=np.repeat(record.command, 2, axis=1),
            position=np.repeat(record.position, 2, axis=1),
        )
        return replace(self, record=both, axes=[one, replace(one, name=name)])

    @property
    def gain(self) -> float:
        """Relative uncertainty of every input gain."""
        return max(one.gain for one in self.axes)

    @property
    def late(self) -> int:
        """Further samples of delay that the data allow."""
        return max(one.late for one in self.axes)

    @property
    def unseen(self) -> bool:
        """Whether another program is advised, for one axis at least."""
        return any(one.unseen for one in self.axes)

    @property
    def order(self) -> int:
        """States of all axes without their delays: what the record shows of modes."""
        return sum(one.fit.model.order for one in self.axes)

    @property
    def shown_to(self) -> float:
        """Frequency up to which all responses are known to 10 % [Hz]; nan if nowhere."""
        return float(np.min([one.response.band[1] for one in self.axes]))


def identify_machine(record: MachineRecord, most_poles: int, most_delay: int) -> LinearMachineFound:
    """Models, intervals and doubts of all axes of a record.

    Args:
        record: of one axis or more.
        most_poles: largest order beside the integrator.
        most_delay: largest delay [samples].

    Raises:
        ValueError: the record is too short, a signal does not change or is not finite, or no stable
            model explains an axis.
    """
    for k, name in enumerate(record.axes):
        _check(name, record.command[:, k], record.position[:, k])

    def one(k: int) -> LinearAxis:
        return _axis(record, k, most_poles, most_delay)

    with ThreadPoolExecutor(len(record.axes)) as pool:
        axes = list(pool.map(one, range(len(record.axes))))
    return LinearMachineFound(record, axes, [note for axis in axes for note in _notes(axis)])


def _axis(record: MachineRecord, k: int, most_poles: int, most_delay: int) -> LinearAxis:
    name, command, position = record.axes[k], record.command[:, k], record.position[:, k]
    resolution = evidence.resolution_of(position)
    try:
        used, choice = with_or_without_friction(
            AxisRecord(record.dt, command, position), resolution, most_poles, most_delay
        )
        choice, found, cancelled = _settled(used, choice, most_delay)
        rivals = rivals_of(used, found, choice, most_delay)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ValueError(f"{name}: {error}") from None
    fit = found.fit
    estimate = evidence.estimate_of(fit)
    response = evidence.response_of(fit, estimate)
    output, explained = held_out(used, choice)
    if explained <= 0 or not np.isfinite(response.band[1]):
        raise ValueError(f"{name}: {_unexplained(command, position)}")
    dispersion = evidence.dispersion(fit)
    stands = float(np.mean(evidence.speed_signs(position, resolution) == 0))
    if doubt := _doubt(explained, dispersion, stands, friction_of(fit) is not None):
        raise ValueError(f"{name}: {doubt}")
    rivals, equals = {d: one / dispersion for d, one in rivals.items()}, found.equals(dispersion)
    others = [one.fit for one in choice.richer]
    if (longer := with_part(used, fit)) is not None:
        others.append(longer)
    own = own_response(fit, estimate, [*equals, *(one.model for one in others)])
    response = held_response(own, equals, others)
    if dispersion > 1:
        response = evidence.doubted(response, position, fit.residual)
    surest = response if dispersion > 1 else own
    gain, gain_by = gain_uncertainty(used, fit, surest, response.band)
    return LinearAxis(
        name=name,
        fit=fit,
        estimate=estimate,
        response=response,
        choice=choice,
        rivals=rivals,
        held_out=output,
        explained=explained,
        friction=friction_of(fit),
        offset=float(fit.drag[1]) if len(fit.drag) > 1 else 0.0,
        saturated=evidence.saturated(command),
        coupling=_coupling(record, k, fit),
        gain=gain,
        gain_by=gain_by,
        dispersion=dispersion,
        late=int(any(lag(fit.model, one) > LATE for one in equals)),
        resolution=resolution,
        encoder_noise=encoder_noise(fit, resolution),
        cancelled=cancelled,
    )


def _unexplained(command: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"]) -> str:
    """Why a stable model does not explain an axis."""
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


def _doubt(explained: float, dispersion: float, stands: float, friction: bool) -> str:
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


def _settled(
    record: AxisRecord, choice: Choice, most_delay: int
) -> tuple[Choice, Settled, int | None]:
    """Model on the whole record, without a hidden mode that lasts where fewer poles have none.

    With the poles of the first that had one.
    """
    found, cancelled = settled(record, choice.best.fit, most_delay), None
    while lasting_hidden_mode(found.fit) and (fewer := of_fewer_poles(choice)) is not None:
        cancelled = cancelled or choice.best.structure.poles
        choice, found = fewer, settled(record, fewer.best.fit, most_delay)
    return choice, found, cancelled


def _coupling(record: MachineRecord, k: int, fit: AxisFit) -> dict[str, float]:
    found = {}
    for j, name in enumerate(record.axes):
        if j == k:
            continue
        part, number = evidence.coupling(fit, record.command[:, j])
        count = len(fit.model.numerator)
        chance = float(f_distribution.sf(number, count, len(fit.errors)))
        found[name] = part if chance < LEVEL else 0.0
    return found


def _notes(axis: LinearAxis) -> list[str]:
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
    if axis.cancelled is not None:
        notes.append(
            f"{name}: a zero cancels one of the {axis.cancelled} poles of a likelier model, or a "
            "pair rings longer than any machine: the record does not show them, this one has fewer"
        )
    if axis.unseen:
        shown = _up_to(axis.response.band[1])
        if axis.choice.richer:
            words = "a model with more poles is likelier, but the record hardly shows it; the two "
            words += f"agree {shown}. Above that"
        else:
            words = f"the response is known to 10 % {shown}; the record does not show whether the "
            words += "axis rings above that. There"
        notes.append(
            f"{name}: {words} tuned loops stay slow enough for what is possible, and the delay may "
            f"stand for what is faster: {_advice(axis)}"
        )
    if axis.delays:
        found, others = axis.fit.model.delay, " or ".join(map(str, axis.delays))
        family = f"; the family holds {found} and {found + 1}" if axis.late else ""
        family += ", the intervals of the response hold the models with all of these"
        notes.append(
            f"{name}: the motion is too smooth to tell {found} from {others} samples of delay"
            f"{family}"
        )
    if axis.friction is not None:
        value, deviation = axis.friction
        notes.append(
            f"{name}: dry friction takes {value:.4g} of the command (+- {2 * deviation:.2g}); the "
            "model is what is left without it. The file states the largest of its axes"
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
    if axis.gain > LEAST_GAIN:
        notes.append(f"{name}: the family's {100 * axis.gain:.2g} % come from {axis.gain_by}")
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


def _check(name: str, command: np.ndarray, position: np.ndarray) -> None:
    if len(command) < FEWEST:
        raise ValueError(f"{name}: needs at least {FEWEST} samples, received {len(command)}")
    for what, values in (("command", command), ("position", position)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name}: the {what} holds NaN or inf")
        if np.ptp(values) == 0:
            raise ValueError(f"{name}: the {what} never changes, so nothing can be seen")

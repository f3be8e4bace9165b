"""Order and delay of an axis model, by what it predicts of data that it was not fitted to.

Every structure, with the noise filter of its own residual, is fitted to the first part of the
record and predicts the rest one step ahead. Of all that the best does not clearly beat the smallest
is taken: a record that does not show a mode gives a model without. Clearly: by the likelihood of
the rest, and not in one place alone. The best is one of those whose modes are all seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.evidence import WINDOW
from tuning.identification.linear.hidden_modes import hidden_modes
from tuning.identification.linear.noise_model import (
    WHITE,
    disturbance_filter,
    whitened,
    whitening,
)
from tuning.identification.linear.output_error import (
    AxisFit,
    AxisRecord,
    Structure,
    fitted,
    predicted,
    simulated,
    started,
    structure_of,
)
from tuning.identification.linear.pieces import (
    SHORT,
    free_start,
    short_whitening,
    started_apart,
)
from tuning.identification.linear.resonance import with_resonance

TRAINING = 0.7  # of the record
FIRST_TERMS = 24  # coefficients of the whitening filter before any model
NOISE_TERMS = 200  # and at most of the one after: counts on top of a drift have a long memory
BEGIN = 260  # rows that no structure is judged by: its delay and filter reach before the record
MORE = 2  # samples of delay beyond the best of a smaller order that are tried
GLANCES = 2  # of model and noise filter in turn, while delays are compared
BLOCK = 200  # samples whose mean counts as one independent value of the squared error
LIKELIER = 10.0  # gain in log-likelihood of the rest: of a dozen models one gains 5 by chance
CHANCE = 1e-3  # that a richer model is likelier without reason: of ten, in one axis of a hundred
BURSTS = 1.5  # standard errors of its mean: one corner that alone is better gives 1, two give 1.4
DRAGGED = 3  # of Gauss-Newton at a glance, where friction has to be found as well
STEPS = 5  # of Gauss-Newton while orders and delays are compared
TELLS = 5.0  # difference of log-likelihoods that tells two delays apart
ROUNDS = 3  # of model and filter in turn


@dataclass(frozen=True)
class Candidate:
    """A fitted structure and its errors on the rest of the record.

    Attributes:
        fit: on the first part.
        held_out: one-step errors on the rest, with the noise filter of the first part, as large as
            they are where no start of a piece is fitted to them (R,) [m].
    """

    fit: AxisFit
    held_out: Float[np.ndarray, " R"]

    @property
    def structure(self) -> Structure:
        """What it has room for."""
        return structure_of(self.fit.model)

    @property
    def loss(self) -> float:
        """Mean square of the held-out errors [m^2]."""
        return float(np.mean(self.held_out**2))


@dataclass(frozen=True)
class Choice:
    """What the search found.

    Attributes:
        best: the chosen structure, fitted to the end to the first part.
        all: every structure tried to the end, best prediction first.
    """

    best: Candidate
    all: list[Candidate]

    @property
    def richer(self) -> list[Candidate]:
        """Structures with more parameters that the whole record makes likelier, and not by chance.

        By the likelihood ratio. None of them is clearly better on the rest of the record alone, or
        it had been chosen.
        """
        return [
            one
            for one in self.all
            if (more := _size(one) - _size(self.best)) > 0
            and chi2.sf(2 * _likelier(one, self.best), more) < CHANCE
        ]

    @property
    def integrating(self) -> list[Candidate]:
        """Structures with an integrator, the likeliest first."""
        found = [one for one in self.all if one.structure.integrators]
        return sorted(found, key=lambda one: -_likelier(one, self.best))

    @property
    def largest(self) -> list[Candidate]:
        """Structures of the most parameters, the likeliest first; they began differently."""
        most = max(_size(one) for one in self.all)
        largest = [one for one in self.all if _size(one) == most]
        return sorted(largest, key=lambda one: -_likelier(one, self.best))


def chosen(
    record: AxisRecord, integrators: Sequence[int], most_poles: int, most_delay: int
) -> Choice:
    """Structure that predicts the rest of a record from its first part.

    Raises:
        ValueError: no structure gives a stable model.
    """
    cut = int(TRAINING * len(record.position))
    training, rest = record.part(0, cut), record.part(cut, len(record.position))
    first = _first_filter(training)
    pairs: list[tuple[AxisFit, AxisFit]] = []
    for i in integrators:
        latest = most_delay
        for n in range(1 - min(i, 1), most_poles + 1):
            structures = [Structure(n, n + i, i, d) for d in range(latest + 1)]
            glances = [one for s in structures if (one := _glance(training, s, first)) is not None]
            if not glances:
                continue
            found = _without_and_with_part(training, min(glances, key=left_of), most_delay)
            pairs.append(found)
            if n > 0:  # with one pole more the delay is less, or hardly more
                latest = min(found[0].model.delay + MORE, most_delay)
    if not pairs:
        raise ValueError("no stable model explains the record")
    ringing = [
        replace(one, model=with_resonance(training, one))
        for one, _ in pairs
        if len(one.model.denominator) + 2 <= most_poles
    ]
    pairs += [_without_and_with_part(training, one, most_delay) for one in ringing]
    tried = [_judged_on(rest, fit) for pair in pairs for fit in pair]
    tried.sort(key=lambda one: one.loss)
    fit = _alternated(training, _smallest(tried).fit)
    return Choice(_judged_on(rest, fit), tried)


def _judged_on(rest: AxisRecord, fit: AxisFit) -> Candidate:
    """A fit and its errors on the rest of the record."""
    errors = predicted(rest, fit, fit.filter)
    return Candidate(fit, errors * np.sqrt(_freed(fit, len(errors), len(rest.pieces.ends))))


def of_fewer_poles(choice: Choice) -> Choice | None:
    """The choice among structures of fewer poles than the best; None where there are none."""
    poles = choice.best.structure.poles
    fewer = [one for one in choice.all if one.structure.poles < poles]
    return replace(choice, best=_smallest(fewer)) if fewer else None


@dataclass(frozen=True)
class Settled:
    """A structure on a whole record, with the noise filter of its own residual.

    Attributes:
        fit: the model.
        rivals: by how much the logarithm of the likelihood is less with another delay, by delay.
        models: those of the other delays, by delay.
    """

    fit: AxisFit
    rivals: dict[int, float]
    models: dict[int, AxisModel] = field(default_factory=dict)

    def equals(self, dispersion: float = 1.0) -> list[AxisModel]:
        """Models of the other delays that the data do not tell from it.

        Args:
            dispersion: by how much more than noise the errors pull at the model.
        """
        return [self.models[d] for d, less in self.rivals.items() if less / dispersion < TELLS]

    def less_likely(self, other: "Settled") -> float:
        """By how much the logarithm of the likelihood is less than another's."""
        return _likelihood(self.fit) - _likelihood(other.fit)


def settled(record: AxisRecord, start: AxisFit, most_delay: int) -> Settled:
    """Model of a structure on a whole record, with the delay that explains the most.

    Where the motion is too smooth to tell delays apart, the numerator makes up for a wrong one with
    coefficients that fight each other: of equals the one with the smallest is taken.
    """
    found = {start.model.delay: _alternated(record, start)}
    while True:
        equal = _equal(found)
        near = {d for one in equal for d in (one - 1, one + 1) if 0 <= d <= most_delay}
        if near <= found.keys():
            break
        for d in sorted(near - found.keys()):
            beside = found[min(equal, key=lambda one: abs(one - d))]
            found[d] = _alternated(record, replace(beside, model=replace(beside.model, delay=d)))
    best = min(_equal(found), key=lambda d: float(np.linalg.norm(found[d].model.numerator)))
    least = _likelihood(found[best])
    rivals = {d: _likelihood(v) - least for d, v in found.items() if d != best}
    return Settled(found[best], rivals, {d: found[d].model for d in rivals})


def _equal(found: dict[int, AxisFit]) -> list[int]:
    """Delays that the data do not tell from the best."""
    least = min(_likelihood(one) for one in found.values())
    return [d for d, one in found.items() if _likelihood(one) - least < TELLS]


def _alternated(record: AxisRecord, start: AxisFit) -> AxisFit:
    """Model and noise filter in turn."""
    fit, filter_ = start, start.filter
    for _ in range(ROUNDS):
        fit = fitted(record, structure_of(fit.model), filter_, fit.model, drag=fit.drag)
        filter_ = filter_of(record, fit)
    return fitted(record, structure_of(fit.model), filter_, fit.model, drag=fit.drag)


def _likelihood(fit: AxisFit) -> float:
    """Minus its logarithm, but for a constant."""
    return 0.5 * len(_judged(fit)) * float(np.log(left_of(fit)))


def _glance(
    record: AxisRecord, structure: Structure, filter_: Float[np.ndarray, " w"]
) -> AxisFit | None:
    """Quick model, and the noise filter of its own residual, in turn; the best of three.

    One begins without any filter: where the first one hides the motion, its start is poor.
    """
    tried = [_quick(record, structure, _none(record))]
    if record.pieces and record.pieces.terms == SHORT:  # what is left is nearly white
        return tried[0]
    for _ in range(GLANCES):
        found = _quick(record, structure, filter_)
        if found is None:
            break
        filter_ = found.filter
        tried.append(found)
    return min((one for one in tried if one is not None), key=left_of, default=None)


def _quick(
    record: AxisRecord, structure: Structure, filter_: Float[np.ndarray, " w"]
) -> AxisFit | None:
    """Model of a start under a filter, with the filter of its own residual."""
    try:
        model = started(record, structure, filter_)
        if record.drags:  # the start has none of them
            fit = fitted(record, structure, filter_, model, DRAGGED)
        else:
            fit = simulated(record, model, filter_)
    except (ValueError, np.linalg.LinAlgError):
        return None
    if not np.isfinite(fit.residual).all():
        return None
    return replace(fit, filter=filter_of(record, fit))


def _walked(record: AxisRecord, start: AxisFit, most_delay: int) -> AxisFit:
    """Model refined by a few steps, its delay moved while that leaves less."""
    best = refined_a_little(record, start)
    for way in (1, -1):
        while 0 <= best.model.delay + way <= most_delay:
            model = replace(best.model, delay=best.model.delay + way)
            other = refined_a_little(record, replace(best, model=model))
            if left_of(other) >= left_of(best):
                break
            best = other
    return best


def _without_and_with_part(
    record: AxisRecord, start: AxisFit, most_delay: int
) -> tuple[AxisFit, AxisFit]:
    """Model refined, and the one with a delay of a part of a sample more."""
    whole = _walked(record, start, most_delay)
    return whole, _walked(record, replace(whole, model=_longer(whole.model)), most_delay)


def with_part(record: AxisRecord, fit: AxisFit) -> AxisFit | None:
    """The model with a delay of a part of a sample more, or less; None where it has room for one.

    Whichever leaves less.
    """
    later, i = _longer(fit.model), fit.model.integrators
    if len(later.numerator) > len(later.denominator) + i + 1:
        return None
    tried = [later]
    if later.delay > 0:
        sooner = np.append(0.0, fit.model.numerator)
        tried.append(replace(later, numerator=sooner, delay=later.delay - 1))
    found = [fitted(record, structure_of(one), fit.filter, one, drag=fit.drag) for one in tried]
    return min(found, key=lambda one: one.loss)


def _longer(model: AxisModel) -> AxisModel:
    """The model with room for a part of a sample: n + i + 1 coefficients in the numerator.

    An axis of n + i states answers a held command that comes late by such a part with as many.
    """
    return replace(model, numerator=np.append(model.numerator, 0.0))


def refined_a_little(record: AxisRecord, start: AxisFit) -> AxisFit:
    """A few steps of Gauss-Newton; then the noise filter of what they leave."""
    structure = structure_of(start.model)
    fit = fitted(record, structure, start.filter, start.model, STEPS, start.drag)
    return replace(fit, filter=filter_of(record, fit))


def left_of(fit: AxisFit) -> float:
    """Variance of what neither the model nor the past explains [m^2]."""
    errors = _judged(fit)
    return float(np.var(errors)) * _freed(fit, len(errors), len(fit.pieces.ends))


def _freed(fit: AxisFit, rows: int, pieces: int) -> float:
    """By how much a variance grows without the starts of pieces, one number for every state each.

    More poles would otherwise leave less, whether they are there or not.
    """
    return rows / max(rows - pieces * fit.model.order, 1)


def filter_of(record: AxisRecord, fit: AxisFit) -> Float[np.ndarray, " w"]:
    """Noise filter of what a fit leaves."""
    if record.pieces:
        return short_whitening(fit.residual, record.pieces)
    return whitening(fit.residual, NOISE_TERMS)


def _first_filter(record: AxisRecord) -> Float[np.ndarray, " w"]:
    """Noise filter before any model."""
    if record.pieces:
        return _none(record)
    return disturbance_filter(record.command, record.position, FIRST_TERMS)


def _none(record: AxisRecord) -> Float[np.ndarray, " w"]:
    return record.pieces.none if record.pieces else WHITE


def _judged(fit: AxisFit) -> Float[np.ndarray, " J"]:
    """What neither the model nor the past explains, without the first rows [m].

    In pieces the starts are fitted behind the filter, as the errors are.
    """
    first = min(BEGIN, len(fit.residual) // 3)  # a short record has a short filter
    left = whitened(fit.residual, fit.filter)
    if not fit.pieces:
        return left[fit.rows[fit.rows >= first]]
    below = np.concatenate([[1.0], fit.model.denominator])
    free = free_start(below, fit.model.integrators, fit.filter, fit.pieces)
    errors = started_apart(left[:, None], free, fit.pieces, len(fit.filter) - 1)[:, 0]
    return errors[fit.rows >= first]


def _smallest(found: list[Candidate]) -> Candidate:
    """Fewest parameters among those that the best without a hidden mode does not clearly beat.

    In pieces such a mode hides friction, as each has a start of its own: there, where a candidate
    has none, only such ones count.
    """
    seen = [one for one in found if not hidden_modes(one.fit).size] or found
    apart = bool((np.diff(seen[0].fit.rows) > 1).any())
    good = [one for one in (seen if apart else found) if not _clearly_better(seen[0], one)]
    return min(good, key=_size)


def _likelier(one: Candidate, other: Candidate) -> float:
    """Gain in log-likelihood over both parts of the record."""
    first = len(_judged(one.fit))
    rest = min(len(one.held_out), len(other.held_out))
    gains = (
        first * np.log(left_of(other.fit) / left_of(one.fit)),
        rest * np.log(other.loss / one.loss),
    )
    return 0.5 * float(sum(gains))


def held_out(record: AxisRecord, choice: Choice) -> tuple[Float[np.ndarray, " R"], float]:
    """Simulation of the rest by the model of the first part, and the speed that it explains."""
    cut = int(TRAINING * len(record.position))
    rest, fit = record.part(cut, len(record.position)), choice.best.fit
    output = simulated(rest, fit.model, drag=fit.drag).output

    return output, part_explained(rest.position, output)


def part_explained(position: Float[np.ndarray, " T"], output: Float[np.ndarray, " T"]) -> float:
    """Part of the variance of the speed that a simulated position explains; 0 where none moves."""

    def speed(signal: np.ndarray) -> np.ndarray:
        return signal[WINDOW:] - signal[:-WINDOW]

    variance = float(np.var(speed(position)))
    return 1 - float(np.var(speed(position - output))) / variance if variance > 0 else 0.0


def _size(one: Candidate) -> int:
    return one.structure.poles + one.structure.zeros


def _clearly_better(best: Candidate, other: Candidate) -> bool:
    rows = min(len(best.held_out), len(other.held_out))
    one, two = best.held_out[-rows:] ** 2, other.held_out[-rows:] ** 2
    means = np.array([part.mean() for part in np.array_split(two - one, max(rows // BLOCK, 2))])
    likelier = 0.5 * rows * np.log(two.mean() / one.mean()) > LIKELIER
    return bool(likelier and means.mean() > BURSTS * means.std(ddof=1) / np.sqrt(len(means)))

"""Dry friction of an axis: looked for in every record, taken along where it is there.

    y = G (q^-d u + f S) + ...,      S = -sign(speed), without the delay of the command

Left out, a friction of one or two per cent of the command spoils gain, time constant and delay by
far more than their intervals, as a linear model describes it in part. So f is fitted beside a
linear model for a few steps. Where it is surely above zero and leaves less, all structures are
tried again with it.

Where pieces of the record move one way, friction is one number in each (`pieces`), and whatever
happens at a reversal is left out. Near a standstill it falls with the speed (Stribeck): where
what is fast surely says another value than all of it, as beside small sines, or surely leaves
less, it alone counts if a linear model is poor.
Where there are few such pieces, two forms are tried. An axis that turns at once has a soft sign,
over spans as long as counts ask; one that is held at times has none while it stands, as friction
takes all of the command then.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Float

from tuning.identification.linear import evidence
from tuning.identification.linear.moving import moving, quick
from tuning.identification.linear.order_search import (
    Candidate,
    Choice,
    chosen,
    filter_of,
    held_out,
    left_of,
    refined_a_little,
)
from tuning.identification.linear.output_error import (
    AxisFit,
    AxisRecord,
    Structure,
    fitted,
    started,
)
from tuning.identification.linear.pieces import LONG, SHORT, Pieces

FAIR = 0.99  # part of the variance explained on held-out data below which a model is doubted
SURE = 5.0  # standard deviations
FEWEST = 6  # pieces
GLANCES = 3  # steps of Gauss-Newton
APART = 3.0  # standard deviations between two values of friction that differ
COLOURED = 0.1  # correlation of the errors that asks for a longer noise filter


def with_or_without_friction(
    record: AxisRecord, resolution: float, most_poles: int, most_delay: int
) -> tuple[AxisRecord, Choice]:
    """The record, with the signs of dry friction where they help to simulate what is held out.

    Args:
        record: of the axis, without drags.
        resolution: of its encoder [m].
        most_poles: as in `order_search.chosen`.
        most_delay: the same.

    Raises:
        ValueError: no structure gives a stable model.
    """
    plain = chosen(record, (0, 1), most_poles, most_delay)
    apart = _apart(record, plain, resolution)
    if apart is not None:
        choice = chosen(apart, (1,), most_poles, most_delay)
        if friction_of(choice.best.fit) is not None:
            return apart, choice
    rubbed = _rubbed(record, plain, resolution)
    if rubbed is None:
        return record, plain
    choice = chosen(rubbed, (1,), most_poles, most_delay)
    seen = friction_of(choice.best.fit) is not None
    better = held_out(rubbed, choice)[1] > held_out(record, plain)[1]
    return (rubbed, choice) if seen and better else (record, plain)


def friction_of(fit: AxisFit) -> tuple[float, float] | None:
    """Command that dry friction takes, and its standard deviation; None where it is not sure."""
    estimate = evidence.estimate_of(fit)
    if "friction" not in estimate.names:
        return None
    value, deviation = estimate["friction"], estimate.deviation("friction")
    return (value, deviation) if value > SURE * deviation else None


def soft_signs(
    position: Float[np.ndarray, " T"], unclear: float, half: int
) -> Float[np.ndarray, " T"]:
    """Minus the sign of the speed, soft where it moves by no more than counts or noise [m].

    By the motion between `half - 1` samples before a sample and `half` after it.
    """
    padded = np.pad(position, (half - 1, half), mode="edge")
    return -np.tanh((padded[2 * half - 1 :] - padded[: len(position)]) / unclear)


def _apart(record: AxisRecord, plain: Choice, resolution: float) -> AxisRecord | None:
    """The record in pieces that move one way; None where they are short, or show no friction."""
    if _integrating(plain) is None:
        return None
    signs, ends = moving(record.position, resolution)
    drags, found = (signs, np.ones(len(signs))), None
    poor = held_out(record, plain)[1] < FAIR
    for terms in (SHORT, LONG):
        pieces = Pieces.of(ends, terms)
        apart = replace(record, drags=drags, pieces=pieces)
        fit = _glanced(apart, plain)
        if fit is None:
            break
        fast = replace(apart, pieces=Pieces.of(quick(record.position, signs), terms))
        other = _glanced(fast, plain) if poor else None
        if other is not None and _differ(fit, other):
            apart, fit = fast, other
        found = apart if friction_of(fit) is not None else None
        if np.abs(evidence.correlations(fit)).max() < COLOURED:
            break
    return found


def _differ(one: AxisFit, quicker: AxisFit) -> bool:
    """Whether fast motion surely says another friction than all of it, or surely leaves less.

    By the chance of a variance of white noise, a relative deviation of sqrt(2 / R).
    """
    all_of, fast = friction_of(one), friction_of(quicker)
    if all_of is None or fast is None:
        return fast is not None
    chance = SURE * np.sqrt(2 / len(quicker.rows))
    if left_of(quicker) < (1 - chance) * left_of(one):
        return True
    return abs(all_of[0] - fast[0]) > APART * float(np.hypot(all_of[1], fast[1]))


def _glanced(apart: AxisRecord, plain: Choice) -> AxisFit | None:
    """A model of the first part of a record in pieces; None where there are few."""
    training = apart.part(0, len(plain.best.fit.residual))
    if len(training.pieces.ends) < FEWEST:
        return None
    return _looked(training, plain.best.fit.model.delay)


def _looked(record: AxisRecord, delay: int) -> AxisFit:
    """A model in pieces, of one pole or two, behind no delay or that of the linear model."""
    found = []
    for poles, late in product((1, 2), {0, delay}):
        structure = Structure(poles, poles + 1, 1, late)
        try:
            model = started(record, structure, record.pieces.none)
            fit = fitted(record, structure, record.pieces.none, model, GLANCES)
        except (ValueError, np.linalg.LinAlgError):
            continue
        fit = replace(fit, filter=filter_of(record, fit))
        found.append(refined_a_little(record, fit))
    return min(found, key=left_of)


def _integrating(plain: Choice) -> Candidate | None:
    """The likeliest model with an integrator: friction may hide it."""
    if plain.best.structure.integrators:
        return plain.best
    return plain.integrating[0] if plain.integrating else None


def _rubbed(record: AxisRecord, plain: Choice, resolution: float) -> AxisRecord | None:
    """The record with the form of friction that leaves the least; None where none is likely.

    Friction may also hide the integrator: then nothing simulates well what is held out.
    """
    begun = _integrating(plain)
    if begun is None:
        return None
    found = []
    for delay, one in _forms(record, resolution, begun.fit.model.delay):
        model = replace(begun.fit.model, delay=delay)
        start = replace(begun.fit, model=model, drag=np.zeros(len(one.drags)))
        fit = refined_a_little(one.part(0, len(start.residual)), start)
        if friction_of(fit) is not None:
            found.append((left_of(fit), one))
    least, rubbed = min(found, key=lambda one: one[0], default=(np.inf, None))
    likelier = least < left_of(plain.best.fit)
    return rubbed if likelier or held_out(record, plain)[1] < FAIR else None


def _forms(record: AxisRecord, resolution: float, most: int) -> Iterator[tuple[int, AxisRecord]]:
    """A delay [samples], and the record with a form of the signs for it.

    The stuck one depends on the delay: what is held is the command that arrives. Without friction
    the delay comes out too large, so that it has one for every delay up to that.
    """
    unclear = max(resolution, np.sqrt(2) * evidence.noise_of(record.position))
    signs = evidence.speed_signs(record.position, resolution)
    for delay in range(most + 1):
        arrives = np.concatenate([signs[delay:], np.full(delay, signs[-1])])
        command = np.where(arrives == 0, 0.0, record.command)
        yield delay, replace(record, command=command, drags=(signs, np.abs(signs)))
    for half in evidence.HALVES:
        soft = soft_signs(record.position, unclear, half)
        yield most, replace(record, drags=(soft,))

"""A machine of two or three axes from one record of all of them.

Each axis by itself: a simple model (`simplest`) and a structure by `order_search`, numbers and
intervals on the whole record, friction where it is seen (`friction`). Then what the record cannot
answer, in words, and the family: every gain within the largest of what the intervals say, what two
halves of the record disagree by, and what drives repeat to; and one sample of delay more where the
data do not tell the model from one that answers half a sample later. The intervals of the response
hold the models of all delays that are not told apart, each fitted by itself; those of the richer
models that the record makes likelier without showing them clearly; and those of a model that is
late by a part of a sample, as no delay is known to be of whole ones. The gain does not, as it is
one number for all frequencies; it is taken where these intervals are narrow.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from scipy.stats import f as f_distribution

from tuning.identification.linear import evidence
from tuning.identification.linear.doubts import POOR, beside, doubt, notes, unexplained
from tuning.identification.linear.encoder_noise import encoder_noise
from tuning.identification.linear.found import LinearAxis, LinearMachineFound, MachineRecord
from tuning.identification.linear.friction import (
    FAIR,
    SURE,
    friction_of,
    with_or_without_friction,
)
from tuning.identification.linear.gain_uncertainty import (
    LEAST_GAIN,
    UNKNOWN_GAIN,
    gain_uncertainty,
)
from tuning.identification.linear.held_response import held_response, own_response
from tuning.identification.linear.hidden_modes import lasting_hidden_mode
from tuning.identification.linear.limits import limits_of
from tuning.identification.linear.line_fit import fitted_to
from tuning.identification.linear.measured import measured, related, with_lines
from tuning.identification.linear.order_search import (
    Choice,
    Settled,
    held_out,
    of_fewer_poles,
    settled,
    with_part,
)
from tuning.identification.linear.output_error import AxisFit, AxisRecord
from tuning.identification.linear.periods import periodic_lines, response_of_lines
from tuning.identification.linear.rivals import lag, rivals_of
from tuning.identification.linear.simplest import Simple, judged, simplest

FEWEST = 500  # samples
HALF = 0.5  # of the speed explained: a simple model that shows that columns belong together
LIKE = 3.0  # ratio of what a gain with a delay and an integrator leave that is one
LEVEL = 1e-6  # of the F test for coupling
LINES = 20  # that show a response
LATEST = 5e-3  # [s] of a delay that is looked for in any case
SLOWER = np.geomspace(0.03, 0.5, 8)  # of the lowest line: there a mass with friction is the model
LATE = 0.5  # samples: half of the one that the family has more


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
    return LinearMachineFound(record, axes, [note for axis in axes for note in notes(axis)])


def _axis(record: MachineRecord, k: int, most_poles: int, most_delay: int) -> LinearAxis:
    """The model of the search, or a simple one where that explains more and the search is poor."""
    name, one = record.axes[k], AxisRecord(record.dt, record.command[:, k], record.position[:, k])
    resolution = evidence.resolution_of(one.position)
    simple = simplest(one, resolution, most_delay)
    lines = periodic_lines(one)
    if len(lines.frequency) >= LINES:
        return _from_lines(name, one, lines, simple, resolution, most_poles, most_delay)
    if (simple is None or simple.explained < HALF) and not related(one):
        for j, other in enumerate(record.axes):
            if j != k and related(replace(one, position=record.position[:, j])):
                raise ValueError(
                    f"{name}: its command moves {other}, not {name}: change their columns"
                )
        limited = limits_of(one.command, one.position, one.dt)
        raise ValueError(f"{name}: {limited or unexplained(one.command, one.position)}")
    try:
        axis = _searched(record, k, resolution, most_poles, most_delay)
    except ValueError as error:
        if simple is None or simple.explained < POOR:
            limited = limits_of(one.command, one.position, one.dt)
            raise ValueError(f"{name}: {limited or f'{error}{beside(simple)}'}") from None
        return _simple(name, simple, resolution)
    if simple is not None and _enough(simple, axis):
        return _simple(name, simple, resolution)
    return axis


def _enough(simple: Simple, axis: LinearAxis) -> bool:
    """Whether a simple model explains more than a poor one, or hardly less than an integrator.

    A drive that follows its command has none; a program that repeats itself does not tell a lag of
    a whole period from it.
    """
    left = 1 - simple.explained
    if axis.fit.model.integrators and not simple.fit.model.integrators:
        return left < LIKE * (1 - axis.explained)
    return axis.explained < FAIR and left < 1 - axis.explained


def _simple(name: str, found: Simple, resolution: float) -> LinearAxis:
    """A simple model as an axis: its friction, and an interval of what the record moved."""
    fit, estimate = found.fit, found.estimate
    lines = measured(found.record, fit)
    response = evidence.response_of(fit, estimate)
    excited = evidence.excited_to(response, found.record.position, fit.residual)
    response = with_lines(evidence.as_excited(response, excited), lines, fit.model)
    low, high = response.band
    inner = (response.frequency >= low) & (response.frequency <= high)
    width = float(response.half_width[inner].max(initial=LEAST_GAIN))
    friction = None
    if "friction" in estimate.names:
        friction = (estimate["friction"], estimate.deviation("friction"))
        friction = friction if friction[0] > SURE * friction[1] else None
    return LinearAxis(
        name=name,
        fit=fit,
        estimate=estimate,
        response=response,
        lines=lines,
        choice=found.choice,
        rivals={},
        held_out=found.held_out,
        explained=found.explained,
        friction=friction,
        offset=float(fit.drag[1]) if len(fit.drag) > 1 else 0.0,
        saturated=evidence.saturated(found.record.command),
        coupling={},
        gain=min(width, UNKNOWN_GAIN),
        gain_by="the widest interval of the response where it is known to 10 %",
        dispersion=1.0,
        late=1,
        resolution=resolution,
        encoder_noise=0.0,
    )


def _from_lines(
    name: str,
    record: AxisRecord,
    lines: evidence.Response,
    simple: Simple | None,
    resolution: float,
    most_poles: int,
    most_delay: int,
) -> LinearAxis:
    """The model of what multisines show, with the friction of a mass that slides."""
    shown = lines
    if simple is not None and simple.fit.model.integrators and simple.explained > POOR:
        lowest = lines.frequency[0] * SLOWER
        slow = evidence.response_of(simple.fit, simple.estimate, lowest)
        pairs = zip(vars(slow).values(), vars(lines).values(), strict=True)
        shown = evidence.Response(*(np.concatenate(pair) for pair in pairs))
    latest = max(most_delay, round(LATEST / record.dt))
    model = fitted_to(shown, record.dt, most_poles, latest)
    drag = friction = None
    if model.integrators and simple is not None and "friction" in simple.estimate.names:
        record, drag = simple.record, simple.fit.drag
        friction = (simple.estimate["friction"], simple.estimate.deviation("friction"))
        friction = friction if friction[0] > SURE * friction[1] else None
    fit, choice, output, explained = judged(record, model, drag)
    if drag is not None and simple is not None:  # it sticks where a linear model does not
        output, explained = simple.held_out, simple.explained
    response = response_of_lines(lines, model)
    return LinearAxis(
        name=name,
        fit=fit,
        estimate=evidence.estimate_of(fit),
        response=response,
        lines=lines,
        choice=choice,
        rivals={},
        held_out=output,
        explained=explained,
        friction=friction,
        offset=0.0 if drag is None else float(drag[1]),
        saturated=evidence.saturated(record.command),
        coupling={},
        gain=LEAST_GAIN,
        gain_by="what drives repeat to",
        dispersion=1.0,
        late=0,
        resolution=resolution,
        encoder_noise=encoder_noise(fit, resolution),
    )


def _searched(
    record: MachineRecord, k: int, resolution: float, most_poles: int, most_delay: int
) -> LinearAxis:
    """The model of the order search.

    Raises:
        ValueError: nothing that fits is of use.
    """
    command, position = record.command[:, k], record.position[:, k]
    try:
        used, choice = with_or_without_friction(
            AxisRecord(record.dt, command, position), resolution, most_poles, most_delay
        )
        choice, found, cancelled = _settled(used, choice, most_delay)
        rivals = rivals_of(used, found, choice, most_delay)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ValueError(str(error)) from None
    fit = found.fit
    estimate = evidence.estimate_of(fit)
    response = evidence.response_of(fit, estimate)
    output, explained = held_out(used, choice)
    if explained <= 0 or not np.isfinite(response.band[1]):
        raise ValueError(unexplained(command, position))
    dispersion = evidence.dispersion(fit)
    stands = float(np.mean(evidence.speed_signs(position, resolution) == 0))
    if why := doubt(explained, dispersion, stands, friction_of(fit) is not None):
        raise ValueError(why)
    rivals, equals = {d: one / dispersion for d, one in rivals.items()}, found.equals(dispersion)
    others = [one.fit for one in choice.richer]
    if (longer := with_part(used, fit)) is not None:
        others.append(longer)
    own = own_response(fit, estimate, [*equals, *(one.model for one in others)])
    response = held_response(own, equals, others)
    if dispersion > 1:
        response = evidence.doubted(response, position, fit.residual)
    lines = measured(used, fit)
    response = evidence.as_excited(response, evidence.excited_to(response, position, fit.residual))
    response = with_lines(response, lines, fit.model)
    surest = response if dispersion > 1 else own
    gain, gain_by = gain_uncertainty(used, fit, surest, response.band)
    return LinearAxis(
        name=record.axes[k],
        fit=fit,
        estimate=estimate,
        response=response,
        lines=lines,
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


def _check(name: str, command: np.ndarray, position: np.ndarray) -> None:
    if len(command) < FEWEST:
        raise ValueError(f"{name}: needs at least {FEWEST} samples, received {len(command)}")
    for what, values in (("command", command), ("position", position)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name}: the {what} holds NaN or inf")
        if np.ptp(values) == 0:
            raise ValueError(f"{name}: the {what} never changes, so nothing can be seen")

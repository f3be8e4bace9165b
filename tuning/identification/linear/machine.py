"""A machine of two or three axes from one record of all of them.

Each axis by itself, one way for every record: the simplest model (`rigid_axis`), which knows
friction and what is slow; lines of the frequency response (`nonparametric`), from the periods of
the record or else beside that model; a model of what the lines show (`vector_fitting`), unless the
simplest explains them. The interval of the response is that of the lines. Where none is, that of a
hidden resonance stands for it: a loop is recommended for what was measured alone.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from scipy.stats import f as f_distribution

from tuning.identification.linear import diagnosis, nonparametric, rigid_axis, validation
from tuning.identification.linear.identified_axes import IdentifiedAxis, IdentifiedMachine
from tuning.identification.linear.machine_record import MachineRecord
from tuning.identification.linear.output_error import AxisFit, AxisRecord
from tuning.identification.linear.rigid_axis import Judged, Simple, judged
from tuning.identification.linear.validation import Estimate, Response
from tuning.identification.linear.vector_fitting import FLOOR, fitted_to, joined

LINES = 12  # that show a response
HALF = 0.5  # of the speed, explained by a model of columns that belong together; of a slow response
# of the lines within their intervals, where a model is enough; of spectra
MOSTLY, BLURRED = 0.9, 0.7
LATEST = 5e-3  # [s] of a delay that is looked for in any case
SLOWER = np.geomspace(0.03, 0.5, 8)  # of the lowest line: there a mass with friction is the model
LEAST_GAIN, UNKNOWN_GAIN = 0.02, 0.99  # no drive repeats better from day to day; of any gain
# times as much left of the motion as by the simple model, beyond which lines mislead: an axis that
# sticks leaves a linear model some; spectra are bent by feedback
WORSE_THAN_LINES, WORSE_THAN_SPECTRA = 10.0, 1.2
SURE = 5.0  # standard deviations
LEVEL = 1e-6  # of the F test for coupling


def identify_machine(record: MachineRecord, most_poles: int, most_delay: int) -> IdentifiedMachine:
    """Models, intervals and warnings of all axes of a record.

    Args:
        record: of one axis or more.
        most_poles: largest order beside the integrator.
        most_delay: largest delay [samples].

    Raises:
        ValueError: `MachineRecord.checked` refuses the record, or no stable model explains an axis.
    """
    record, slower = record.checked().at_own_rate()

    def one(k: int) -> IdentifiedAxis:
        return _axis(record, k, most_poles, most_delay)

    with ThreadPoolExecutor(len(record.axes)) as pool:
        axes = list(pool.map(one, range(len(record.axes))))
    said = [note for axis in axes for note in diagnosis.notes(axis)]
    return IdentifiedMachine(record, axes, slower + said)


def _axis(record: MachineRecord, k: int, most_poles: int, most_delay: int) -> IdentifiedAxis:
    """One axis: the simplest model that explains its lines."""
    name, one = record.axes[k], AxisRecord(record.dt, record.command[:, k], record.position[:, k])
    resolution = validation.resolution_of(one.position)
    if not diagnosis.follows(one.command, one.position) and rigid_axis.is_reversed(one, resolution):
        raise ValueError(
            f"{name}: the position falls where the command rises: the sign of the command or of "
            "the encoder is reversed; change that of one of the two columns"
        )
    simple = rigid_axis.simplest(one, resolution, most_delay)
    excited = nonparametric.periodic_lines(one)
    if len(excited.frequency) < LINES:
        excited = nonparametric.NO_LINES
        if (simple is None or simple.explained < HALF) and not nonparametric.related(one):
            for j, other in enumerate(record.axes):
                if j != k and nonparametric.related(replace(one, position=record.position[:, j])):
                    raise ValueError(
                        f"{name}: its command moves {other}, not {name}: change their columns"
                    )
            raise ValueError(f"{name}: {_why(one, simple, False)}")
    lines = excited if len(excited.frequency) or simple is None else nonparametric.measured(simple)
    found, agreed = None, np.inf
    if simple is not None and (
        len(lines.frequency) < LINES or _enough(simple, lines, len(excited.frequency) > 0)
    ):
        found = simple
    elif len(lines.frequency) >= LINES:
        worse = WORSE_THAN_LINES if len(excited.frequency) else WORSE_THAN_SPECTRA
        found = _fitted(one, lines, simple, most_poles, most_delay, worse)
        if found is None and simple is not None:
            found, excited = simple, nonparametric.NO_LINES
            if simple.fit.model.integrators:  # a loop around it bends them
                agreed = nonparametric.agreed_to(lines, simple.fit.model)
                lines = nonparametric.NO_LINES
    given = one.command, one.position
    away = validation.fastest_growth(*given) > diagnosis.RUNS_AWAY
    if found is None or found.explained <= (diagnosis.POOR if away else 0.0):
        raise ValueError(f"{name}: {_why(one, simple, True)}")
    fit = found.fit
    stands = float(np.mean(validation.speed_signs(one.position, resolution) == 0))
    estimate = validation.estimate_of(fit)
    sure = _friction(simple.estimate if simple and fit.model.integrators else estimate)
    dispersion = validation.dispersion(fit)
    if why := diagnosis.unusable(found.explained, dispersion, stands, sure is not None):
        if found.explained < HALF:
            raise ValueError(f"{name}: {_why(one, simple, True)}")
        shown = _limit(one, simple) or diagnosis.follows(*given)
        raise ValueError(f"{name}: {shown or why + diagnosis.beside(simple)}")
    if len(excited.frequency):
        lines = nonparametric.averaged(excited, fit.model)
        excited = nonparametric.clear_of(lines)
    if len(lines.frequency) >= LINES:
        response = nonparametric.response_of_lines(lines, fit.model)
    else:
        own = validation.response_of(fit, estimate)
        excited_to = validation.excited_to(own, one.position, fit.residual)
        response = validation.as_excited(own, min(agreed, excited_to))
    return IdentifiedAxis(
        name=name,
        fit=fit,
        estimate=estimate,
        response=response,
        lines=excited,
        held_out=found.output,
        explained=found.explained,
        friction=sure,
        ripple=simple.ripple / sure[0] if simple and sure else 0.0,
        stribeck=simple.stribeck if simple and sure else None,
        offset=float(fit.drag[1]) if len(fit.drag) > 1 else 0.0,
        saturated=validation.saturated(one.command),
        coupling=_coupling(record, k, fit),
        gain=float(np.clip(response.half_width.min(), LEAST_GAIN, UNKNOWN_GAIN)),
        dispersion=dispersion,
        late=0 if len(excited.frequency) else 1,
        resolution=resolution,
        encoder_noise=validation.encoder_noise(fit, resolution),
    )


def _friction(estimate: Estimate) -> tuple[float, float] | None:
    """Command that dry friction takes, and its standard deviation; None where it is not sure."""
    if "friction" not in estimate.names:
        return None
    value, deviation = estimate["friction"], estimate.deviation("friction")
    return (value, deviation) if value > SURE * deviation else None


def _why(record: AxisRecord, simple: Simple | None, related: bool) -> str:
    """Why nothing explains a record whose command and position are `related`, or not."""
    unexplained = diagnosis.unexplained(record.command, record.position, related)
    return _limit(record, simple) or unexplained + diagnosis.beside(simple)


def _limit(record: AxisRecord, simple: Simple | None) -> str:
    """What of a record keeps a model from explaining it, friction included; else empty."""
    limited = diagnosis.limits_of(record.command, record.position, record.dt)
    return limited or diagnosis.friction_hides(record.command, simple)


def _enough(simple: Simple, lines: Response, excited: bool) -> bool:
    """Whether a simple model explains the lines; those of spectra are blurred by their windows."""
    G = simple.fit.model.response(2 * np.pi * lines.frequency)
    inside = np.abs(G / lines.value - 1) < lines.half_width
    part = float(np.mean(inside))
    return simple.explained > diagnosis.POOR and part > (MOSTLY if excited else BLURRED)


def _fitted(
    record: AxisRecord,
    lines: Response,
    simple: Simple | None,
    most_poles: int,
    most_delay: int,
    worse: float,
) -> Judged | None:
    """The model of the lines; of a mass that slides with its friction and its slow motion.

    None where the lines mislead: their model has another slow motion, or the simple one gives the
    motion better, under the same friction. Lines of spectra are bent by feedback, and a trajectory
    that repeats is no period of the record.
    """
    latest = max(most_delay, round(LATEST / record.dt))
    if simple is None or simple.explained < diagnosis.POOR:
        models = (fitted_to(lines, record.dt, most_poles, latest, (i,)) for i in (0, 1))
        return max((judged(record, one) for one in models), key=lambda one: one.explained)
    integrators = simple.fit.model.integrators
    below = lines.frequency[0] * SLOWER
    if integrators:
        slow = validation.response_of(simple.fit, simple.estimate, below)
        model = fitted_to(joined(slow, lines), record.dt, most_poles, latest, (integrators,))
        drag = simple.fit.drag
    else:
        model = fitted_to(lines, record.dt, most_poles, latest, (0,))
        slow = rigid_axis.moves_of(simple.record, model, below)
        floor = np.repeat([0.0, FLOOR], [len(below), len(lines.frequency)])
        model = fitted_to(joined(slow, lines), record.dt, most_poles, latest, (0,), floor)
        drag = rigid_axis.reversal_error(simple.record, model)
    found = judged(simple.record, model, drag)
    alone = judged(simple.record, simple.fit.model, simple.fit.drag)
    apart = np.abs(model.response(2 * np.pi * below) / slow.value - 1)
    if apart.max() > HALF or 1 - found.explained > worse * (1 - alone.explained):
        return None
    if not integrators:
        return found
    # it sticks where a linear model does not
    return Judged(simple.record, found.fit, simple.output, simple.explained)


def _coupling(record: MachineRecord, k: int, fit: AxisFit) -> dict[str, float]:
    found = {}
    for j, name in enumerate(record.axes):
        if j == k:
            continue
        part, number = validation.coupling(fit, record.command[:, j])
        count = len(fit.model.numerator)
        chance = float(f_distribution.sf(number, count, len(fit.errors)))
        found[name] = part if chance < LEVEL else 0.0
    return found

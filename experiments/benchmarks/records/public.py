"""`jcontour bench public --records FOLDER`: predictions for public records of real machines.

Every record that lies in the folder is read, identified and predicted; the others keep what is
stored beside this file. The site shows it.
"""

import json
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from experiments.tables import Column, Table
from jcontour.app.files.log_file import LogColumns, read_log
from jcontour.app.files.log_table import Table as LogTable
from jcontour.app.files.log_table import read_table
from jcontour.app.files.response_file import read_response
from jcontour.app.files.results.machine_results import LinearAxisResult
from jcontour.app.flags.others import Bench
from jcontour.app.machines.identified import axis_result
from jcontour.app.reports.figures.axes import save_figure
from jcontour.app.reports.figures.identification import response_figure
from jcontour.plants import emps
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.machine_record import MachineRecord
from tuning.identification.linear.output_error import AxisRecord
from tuning.identification.linear.rigid_axis import simplest
from tuning.identification.linear.validation import resolution_of
from tuning.response_loop import ResponseLoop, crossover, sensitivity, tuned

STORED = Path(__file__).with_name("public.json")
PICTURE = Path(__file__).parents[2] / "docs" / "pictures" / "measured-response.png"
MOST_POLES, MOST_DELAY = 3, 10
MOST_WORDS = 249  # letters of a refusal
PULSES = "pulses_n"  # [V], despite its name
Row = tuple[str, str, str, bool]  # a prediction without its record


@dataclass(frozen=True)
class Prediction:
    """One number of a record."""

    record: str
    quantity: str  # what is compared, with its unit
    wanted: str  # measured, or by an independent calculation
    predicted: str  # or identified here
    holds: bool  # whether it is as good as was asked for


def measured(flags: Bench, tell: Callable[[str], None]) -> list[Prediction]:
    """Predict the records in the folder and store the results.

    Raises:
        ValueError: no folder is given, or it holds none of the records.
    """
    if flags.records is None:
        raise ValueError("bench public: needs --records, the folder of the public records")
    rows = stored()
    here = {name: one for name, one in RECORDS.items() if (flags.records / name).exists()}
    if not here:
        raise ValueError(f"{flags.records}: holds none of {', '.join(RECORDS)}")
    for name, (title, predicted) in here.items():
        new = [Prediction(title, *one) for one in predicted(flags.records / name)]
        for row in new:
            tell(f"{name}: {row.quantity}: {row.predicted} ({row.wanted})")
        rows = [row for row in rows if row.record != title] + new
    order = [title for title, _ in RECORDS.values()]
    rows.sort(key=lambda row: order.index(row.record))
    STORED.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    return rows


def stored() -> list[Prediction]:
    """Results as they were stored last."""
    return [Prediction(**row) for row in json.loads(STORED.read_text())]


COLUMNS: dict[str, Column] = {
    "record": "record",
    "quantity": "quantity",
    "measured": "wanted",
    "predicted": "predicted",
    "holds": lambda row: "yes" if row.holds else "NO",
}


def tables(result: list[Prediction]) -> list[Table | str]:
    """Measured and predicted."""
    table = Table("Public records", result, COLUMNS, words=5)
    return [table, f"{sum(row.holds for row in result)} of {len(result)} hold."]


def axis_of(path: Path, columns: LogColumns) -> LinearAxisResult:
    """The axis that is identified from a log; one that shows none is a ValueError."""
    log = read_log(path, ("X",), columns)
    record = MachineRecord(log.dt, ("X",), log.command, log.position)
    return axis_result(identify_machine(record, MOST_POLES, MOST_DELAY).axes[0])


def cascade_factors(table: LogTable) -> Float[np.ndarray, " 2"]:
    """Factors of the documented cascade and of the pulses in the recorded voltage."""
    speed = np.diff(table["qm"], prepend=table["qm"][0]) / emps.SAMPLE_PERIOD
    wanted = emps.SPEED_GAIN * emps.POSITION_GAIN * (table["qg"] - table["qm"])
    parts = [wanted, emps.SPEED_GAIN * speed, np.ones(len(speed))]  # the noisy speed apart
    if PULSES in table:
        parts.append(table[PULSES])
    factors = np.linalg.lstsq(np.stack(parts, axis=1), table["vir"])[0]
    return np.array([factors[0], factors[-1] if PULSES in table else 1.0])


class Sliding(NamedTuple):
    """A mass with friction: gain [m/s/V], time constant [s], friction and offset [V]."""

    gain: float
    constant: float
    friction: float
    offset: float

    @classmethod
    def of(cls, path: Path, columns: LogColumns) -> "Sliding":
        """The one that a record shows by instruments."""
        log = read_log(path, ("X",), columns)
        record = AxisRecord(log.dt, log.command[:, 0], log.position[:, 0])
        simple = simplest(record, resolution_of(record.position), MOST_DELAY)
        assert simple is not None
        model, (friction, offset) = simple.fit.model, simple.fit.drag.tolist()
        gain = model.numerator.sum() / (1 + model.denominator.sum()) / log.dt
        return cls(float(gain), float(-log.dt / np.log(model.poles[0].real)), friction, offset)


_G, _C = emps.DRIVE_GAIN, emps.VISCOUS
PUBLISHED = Sliding(_G / _C, emps.MASS / _C, emps.COULOMB / _G, -emps.OFFSET / _G)


def emps_error(
    axis: Sliding,
    asked: Float[np.ndarray, " T"],
    pulses: Float[np.ndarray, " T"],
    factors: Float[np.ndarray, " 2"],
) -> Float[np.ndarray, " T"]:
    """Following error of an axis with friction under the documented cascade [m].

    u = g K_v (K_p (q_r - q) - q') + h pulses, with factors g and h and the speed by differences of
    counted positions.
    Between samples voltage and direction are held, the rest is exact; at rest the axis sticks.
    """
    dt, constant = emps.SAMPLE_PERIOD, axis.constant
    pole = np.exp(-dt / constant)
    lag = constant * (1 - pole)
    place, speed, counted = float(asked[0]), 0.0, float(asked[0])
    error = np.empty(len(asked))
    for k, wanted in enumerate(asked.tolist()):
        before, counted = counted, emps.RESOLUTION * round(place / emps.RESOLUTION)
        error[k] = wanted - counted
        measured_speed = (counted - before) / dt
        u = emps.SPEED_GAIN * (emps.POSITION_GAIN * error[k] - measured_speed)
        u = factors[0] * u + factors[1] * pulses[k]
        force = np.clip(u, -emps.LARGEST_VOLTAGE, emps.LARGEST_VOLTAGE) + axis.offset
        if speed == 0.0 and abs(force) <= axis.friction:
            continue
        way = np.sign(speed) or np.sign(force)
        steady = axis.gain * (force - axis.friction * way)
        after = steady + (speed - steady) * pole
        if way * after < 0:
            speed = 0.0
            continue
        place += (speed - steady) * lag + steady * dt
        speed = after
    return error


def _emps(folder: Path) -> Iterator[Row]:
    columns = LogColumns("t", ("vir",), ("qm",), "m")
    files = {"estimation": "DATA_EMPS.mat", "pulses": "DATA_EMPS_PULSES.mat"}
    gain, friction = 177.8, 0.596
    for kind, file in files.items():
        one = axis_of(folder / file, columns)
        low, high = (1e3 * value for value in one.gain_interval)
        within = abs(1e3 * one.gain / gain - 1) < 0.03 and low <= gain <= high
        interval = f"{1e3 * one.gain:.1f} ({low:.1f} to {high:.1f})"
        yield f"gain, {kind} [mm/s/V]", f"{gain:g}", interval, bool(within)
        rubs = one.friction or 0.0
        within = bool(abs(rubs / friction - 1) < 0.03)
        yield f"dry friction, {kind} [V]", f"{friction:g}", f"{rubs:.3f}", within
        part = f"{100 * one.explained:.2f} %"
        yield f"held-out speed, {kind}", "at least 99.5 %", part, one.explained >= 0.995
    sliding = Sliding.of(folder / files["estimation"], columns)
    for kind, file in files.items():
        table = read_table(folder / file)
        seen, still = table["qg"] - table["qm"], np.zeros(len(table["qg"]))
        size = 1e6 * float(np.sqrt(np.mean(seen**2)))
        for words, factors in (
            ("documented", np.ones(2)),
            ("as in the recorded voltage", cascade_factors(table)),
        ):
            pulses = table.get(PULSES, still)
            off = (emps_error(axis, table["qg"], pulses, factors) for axis in (sliding, PUBLISHED))
            left, theirs = (1e6 * float(np.sqrt(np.mean((one - seen) ** 2))) for one in off)
            yield (
                f"following error in closed loop, {kind}, cascade {words} [um RMS]",
                f"{size:.1f}; published parameters are {theirs:.2f} off",
                f"{left:.2f} off, mass with friction of the estimation record",
                left <= 3.2,
            )


def _sinumerik(folder: Path) -> Iterator[Row]:
    lines = read_response(folder / "AST_AX7.xml")
    theirs = json.loads((folder / "tuned_by_siemens.json").read_text())
    speed, (low, notch) = theirs["speed_controller"], theirs["current_setpoint_filters"]
    names = "Kp_Nms_per_rad", "Tn_s", "f_hz", "fn", "dn", "dd"
    siemens = ResponseLoop(*((speed | low | notch)[name] for name in names))
    seen = lines.frequency >= 3
    at = crossover(lines.frequency[seen], (siemens.response(lines.frequency) * lines.value)[seen])
    ours = tuned(lines.calm, at)
    kept = lines.part(seen).calm
    save_figure(response_figure(kept, {"Siemens": siemens, "jcontour": ours}), PICTURE)
    for lowest, late in ((3, 0.0), (3, theirs["controller_delay_s"]), (10, 0.0)):
        seen = lines.frequency >= lowest
        delay = np.exp(-2j * np.pi * lines.frequency * late)
        worst = [
            float(sensitivity((one.response(lines.frequency) * lines.value * delay)[seen]).max())
            for one in (siemens, ours)
        ]
        beside = f", {1e3 * late:g} ms later" if late else ""
        yield (
            f"Ms of PI with filters, lines from {lowest} Hz, crossover {at:.3g} Hz{beside}",
            f"Siemens {worst[0]:.3f}",
            f"{worst[1]:.3f}",
            worst[1] <= worst[0],
        )
    theirs, mine = (one.gain / one.reset_time for one in (siemens, ours))
    quantity = "integral gain K_p / T_n of the two [Nm/rad]"
    yield quantity, f"Siemens {theirs:.0f}", f"{mine:.0f}", mine >= theirs


def _motor_bench(folder: Path) -> Iterator[Row]:
    columns = LogColumns("time", ("iq_refx",), ("theta_mx",), "rad")
    one = axis_of(folder / "MultisineTypeA.mat", columns)
    hertz = one.resonances[0][0] if one.resonances else float("nan")
    yield "resonance [Hz]", "76", f"{hertz:.1f}", bool(abs(hertz / 76 - 1) < 0.03)
    most = f"{one.measured_to:.0f}"
    yield "response measured to [Hz]", "250 excited", most, most == "250"


def _umich(folder: Path) -> Iterator[Row]:
    columns = LogColumns(None, ("X1_CommandPosition",), ("X1_ActualPosition",), "mm", 0.1)
    try:
        axis_of(folder / "experiment_11.csv", columns)
        said = "a model"
    except ValueError as error:
        said = str(error)
    yield "X", "too slow and coarse to show dynamics", said, "too slow or too coarse" in said


def _logs(least: float, *logs: tuple[str, str, LogColumns]) -> Callable[[Path], Iterator[Row]]:
    """Predictor of the held-out speeds of logs, each with what it is of and a pattern of files."""

    def predicted(folder: Path) -> Iterator[Row]:
        for what, pattern, columns in logs:
            for path in sorted(folder.glob(pattern)):
                try:
                    part = axis_of(path, columns).explained
                    said = f"{100 * part:.2f} %"
                except ValueError as error:
                    part = 0.0
                    said = textwrap.shorten(f"refused: {error}", MOST_WORDS, placeholder=" ...")
                quantity = f"held-out speed, {what or path.stem}"
                yield quantity, f"at least {100 * least:g} %", said, part >= least

    return predicted


_SERVO = LogColumns(None, ("5",), ("1",), "rad", 1e-3)
_RULER = LogColumns(None, ("v",), (r"$\theta$",), "deg", 2e-3)
_JOINTS = (
    LogColumns("rec.time_cont", (f"ref_pos_deg_{joint}",), (f"act_pos_se_deg_{joint}",))
    for joint in (1, 2, 3)
)
RECORDS: dict[str, tuple[str, Callable[[Path], Iterator[Row]]]] = {  # by folder
    "emps": ("EMPS, ball-screw axis (Janot, Gautier, Brunot 2019)", _emps),
    "sinumerik_ast": ("Spindle axis with a SINUMERIK (eliasrhoden/Sinumerik-Ctrl)", _sinumerik),
    "motor_bench": ("Two-inertia motor bench (FdiTools, University of Tokyo)", _motor_bench),
    "kuka": (
        "KUKA KR300 R2500 (Weigand)",
        _logs(0.995, *((f"joint {n}", "rec_A.mat", one) for n, one in enumerate(_JOINTS, 1))),
    ),
    "lorenz_servo": (
        "Small AC servo (TeacherRock/Lorenz_Friction)",
        _logs(0.95, *((file, file, _SERVO) for file in ("data_5.txt", "Lorenz_Fc_1.txt"))),
    ),
    "ruler_robot": (
        "DC motor with a flexible ruler (ryanGT/systemid)",
        _logs(0.95, *((file, file, _RULER) for file in ("swept1-0-10hz.txt", "step1.txt"))),
    ),
    "camber": (
        "Linear actuators (nicolazande/camber-control)",
        _logs(0.95, ("", "*.txt", LogColumns("1", ("3",), ("4",)))),
    ),
    "umich_cnc": ("CNC mill (University of Michigan)", _umich),
}

"""`jcontour bench public --records FOLDER`: predictions for public records of real machines.

Every record that lies in the folder is read, identified and predicted; the others keep what is
stored. The results are stored beside this file, and the page of the docs is made of them.
"""

import json
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from experiments.tables import Column, Table
from jcontour.app.files.log_file import LogColumns, read_log
from jcontour.app.files.log_table import Table as LogTable
from jcontour.app.files.log_table import read_table
from jcontour.app.files.response_file import MeasuredResponse, read_response
from jcontour.app.files.results.machine_results import LinearAxisResult
from jcontour.app.flags.others import Bench
from jcontour.app.machines.identified import axis_result
from jcontour.app.reports.figures.identification import response_figure
from jcontour.app.reports.figures.png import save_figure
from jcontour.plants import emps
from tuning.identification.linear.identified_axes import MachineRecord
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.output_error import AxisRecord
from tuning.identification.linear.rigid_axis import simplest
from tuning.identification.linear.validation import resolution_of
from tuning.response_loop import ResponseLoop, crossover, sensitivity, tuned

STORED = Path(__file__).with_name("public.json")
DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS / "evidence" / "predicted-and-measured.md"
PICTURE = DOCS / "pictures" / "measured-response.png"
TITLE = """# Evidence: predicted and measured

Written by `jcontour bench public --records FOLDER`.
*Held-out*: the last 30 %, from the command alone.

"""
MOST_POLES, MOST_DELAY = 3, 10
MOST_WORDS = 240  # letters of a refusal
PULSES = "pulses_n"  # [V], despite its name
FOLDERS = {
    "emps": "EMPS, ball-screw axis (Janot, Gautier, Brunot 2019)",
    "sinumerik_ast": "Spindle axis with a SINUMERIK (eliasrhoden/Sinumerik-Ctrl)",
    "motor_bench": "Two-inertia motor bench (FdiTools, University of Tokyo)",
    "kuka": "KUKA KR300 R2500 (Weigand)",
    "lorenz_servo": "Small AC servo (TeacherRock/Lorenz_Friction)",
    "ruler_robot": "DC motor with a flexible ruler (ryanGT/systemid)",
    "camber": "Linear actuators (nicolazande/camber-control)",
    "umich_cnc": "CNC mill (University of Michigan)",
}


@dataclass(frozen=True)
class Prediction:
    """One number of a record."""

    folder: str  # of the record
    quantity: str  # what is compared, with its unit
    wanted: str  # measured, or by an independent calculation
    found: str  # predicted or identified here
    holds: bool  # whether it is as good as was asked for


@dataclass(frozen=True)
class PublicBench:
    """All predictions, those of records that are not here as they were stored."""

    rows: list[Prediction]


def measured(flags: Bench, tell: Callable[[str], None]) -> PublicBench:
    """Predict the records in the folder, store the results and write the page.

    Raises:
        ValueError: no folder is given, or it holds none of the records.
    """
    if flags.records is None:
        raise ValueError("bench public: needs --records, the folder of the public records")
    rows = stored()
    here = [name for name in FOLDERS if (flags.records / name).exists()]
    if not here:
        raise ValueError(f"{flags.records}: holds none of {', '.join(FOLDERS)}")
    for name in here:
        new = list(PREDICTED[name](flags.records / name))
        for row in new:
            tell(f"{name}: {row.quantity}: {row.found} ({row.wanted})")
        rows = [row for row in rows if row.folder != name] + new
    rows.sort(key=lambda row: list(FOLDERS).index(row.folder))
    STORED.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    PAGE.write_text(page(rows))
    return PublicBench(rows)


def stored() -> list[Prediction]:
    """Results as they were stored last."""
    return [Prediction(**row) for row in json.loads(STORED.read_text())] if STORED.exists() else []


def page(rows: Sequence[Prediction]) -> str:
    """The page of the docs."""
    lines = ["| record | quantity | measured | predicted | holds |", "|---|---|---|---|---|"]
    for row in rows:
        cells = (row.quantity, row.wanted, row.found, "yes" if row.holds else "**no**")
        lines.append(f"| {' | '.join((FOLDERS[row.folder], *cells))} |")
    picture = f"\n![Both loops](../pictures/{PICTURE.name})\n"
    return TITLE + "\n".join(lines) + "\n" + picture * PICTURE.exists()


def tables(result: PublicBench) -> list[Table | str]:
    """The table of the page."""
    columns: dict[str, Column] = {
        "record": "folder",
        "quantity": "quantity",
        "measured": "wanted",
        "predicted": "found",
        "holds": lambda row: "yes" if row.holds else "NO",
    }
    held = sum(row.holds for row in result.rows)
    return [
        Table("Public records", result.rows, columns, words=5),
        f"{held} of {len(result.rows)} hold. Page: {PAGE.name}",
    ]


def axis_of(path: Path, columns: LogColumns) -> LinearAxisResult:
    """The axis that is identified from a log.

    Raises:
        ValueError: the record shows none.
    """
    log = read_log(path, ("X",), columns)
    record = MachineRecord(log.dt, ("X",), log.command, log.position)
    return axis_result(identify_machine(record, MOST_POLES, MOST_DELAY).axes[0])


def explained(folder: str, what: str, path: Path, columns: LogColumns, least: float) -> Prediction:
    """How much of the held-out speed is explained, at least `least`."""
    asked = f"at least {100 * least:g} %"
    try:
        one = axis_of(path, columns)
    except ValueError as error:
        said = textwrap.shorten(str(error), MOST_WORDS, placeholder=" ...")
        return Prediction(folder, f"held-out speed, {what}", asked, f"refused: {said}", False)
    part = f"{100 * one.explained:.2f} %"
    return Prediction(folder, f"held-out speed, {what}", asked, part, one.explained >= least)


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


def _emps(folder: Path) -> Iterator[Prediction]:
    name, columns = folder.name, LogColumns("t", ("vir",), ("qm",), "m")
    files = {"estimation": "DATA_EMPS.mat", "pulses": "DATA_EMPS_PULSES.mat"}
    axes = {kind: axis_of(folder / file, columns) for kind, file in files.items()}
    gain, friction = 177.8, 0.596
    for kind, one in axes.items():
        low, high = (1e3 * value for value in one.gain_interval)
        yield Prediction(
            name,
            f"gain, {kind} [mm/s/V]",
            f"{gain:g}",
            f"{1e3 * one.gain:.1f} ({low:.1f} to {high:.1f})",
            bool(abs(1e3 * one.gain / gain - 1) < 0.03 and low <= gain <= high),
        )
        rubs = one.friction or 0.0
        within = bool(abs(rubs / friction - 1) < 0.03)
        yield Prediction(name, f"dry friction, {kind} [V]", f"{friction:g}", f"{rubs:.3f}", within)
        part = f"{100 * one.explained:.2f} %"
        holds = one.explained >= 0.995
        yield Prediction(name, f"held-out speed, {kind}", "at least 99.5 %", part, holds)
    sliding = Sliding.of(folder / files["estimation"], columns)
    for (kind, file), published in zip(files.items(), (2.25, 3.16), strict=True):
        table = read_table(folder / file)
        seen, still = table["qg"] - table["qm"], np.zeros(len(table["qg"]))
        size = 1e6 * float(np.sqrt(np.mean(seen**2)))
        for words, factors in (
            ("documented", np.ones(2)),
            ("as in the recorded voltage", cascade_factors(table)),
        ):
            asked = table["qg"], table.get(PULSES, still), factors
            off = emps_error(sliding, *asked) - seen
            left = 1e6 * float(np.sqrt(np.mean(off**2)))
            yield Prediction(
                name,
                f"following error in closed loop, {kind}, cascade {words} [um RMS]",
                f"{size:.1f}; published parameters are {published:g} off",
                f"{left:.2f} off, mass with friction of the estimation record",
                left <= 3.2,
            )


def _sinumerik(folder: Path) -> Iterator[Prediction]:
    lines = read_response(folder / "AST_AX7.xml")
    theirs = json.loads((folder / "tuned_by_siemens.json").read_text())
    speed, (low, notch) = theirs["speed_controller"], theirs["current_setpoint_filters"]
    siemens = ResponseLoop(
        speed["Kp_Nms_per_rad"], speed["Tn_s"], low["f_hz"], notch["fn"], notch["dn"], notch["dd"]
    )
    seen, calm = lines.frequency >= 3, lines.coherence >= 0.8
    at = crossover(lines.frequency[seen], (siemens.response(lines.frequency) * lines.value)[seen])
    ours = tuned(lines.frequency[calm], lines.value[calm], lines.deviation[calm], at)
    kept = MeasuredResponse(*(one[seen & calm] for one in vars(lines).values()))
    save_figure(response_figure(kept, {"Siemens": siemens, "jcontour": ours}), PICTURE)
    for lowest, late in ((3, 0.0), (3, theirs["controller_delay_s"]), (10, 0.0)):
        seen = lines.frequency >= lowest
        delay = np.exp(-2j * np.pi * lines.frequency * late)
        worst = [
            float(sensitivity((one.response(lines.frequency) * lines.value * delay)[seen]).max())
            for one in (siemens, ours)
        ]
        beside = f", {1e3 * late:g} ms later" if late else ""
        yield Prediction(
            folder.name,
            f"Ms of PI with filters, lines from {lowest} Hz, crossover {at:.3g} Hz{beside}",
            f"Siemens {worst[0]:.3f}",
            f"{worst[1]:.3f}",
            worst[1] <= worst[0],
        )
    yield Prediction(
        folder.name,
        "integral gain K_p / T_n of the two [Nm/rad]",
        f"Siemens {siemens.gain / siemens.reset_time:.0f}",
        f"{ours.gain / ours.reset_time:.0f}",
        ours.gain / ours.reset_time >= siemens.gain / siemens.reset_time,
    )


def _motor_bench(folder: Path) -> Iterator[Prediction]:
    columns = LogColumns("time", ("iq_refx",), ("theta_mx",), "rad")
    one = axis_of(folder / "MultisineTypeA.mat", columns)
    hertz = one.resonances[0][0] if one.resonances else float("nan")
    yield Prediction(
        folder.name, "resonance [Hz]", "76", f"{hertz:.1f}", bool(abs(hertz / 76 - 1) < 0.03)
    )
    wanted = f"{250:g} excited"
    yield Prediction(
        folder.name,
        "response measured to [Hz]",
        wanted,
        f"{one.measured_to:.0f}",
        round(one.measured_to) == 250,
    )


def _kuka(folder: Path) -> Iterator[Prediction]:
    for joint in (1, 2, 3):
        columns = LogColumns(
            "rec.time_cont", (f"ref_pos_deg_{joint}",), (f"act_pos_se_deg_{joint}",)
        )
        yield explained(folder.name, f"joint {joint}", folder / "rec_A.mat", columns, 0.995)


def _servo(folder: Path) -> Iterator[Prediction]:
    for file in ("data_5.txt", "Lorenz_Fc_1.txt"):
        columns = LogColumns(None, ("5",), ("1",), "rad", 1e-3)
        yield explained(folder.name, file, folder / file, columns, 0.95)


def _ruler(folder: Path) -> Iterator[Prediction]:
    for file in ("swept1-0-10hz.txt", "step1.txt"):
        columns = LogColumns(None, ("v",), (r"$\theta$",), "deg", 2e-3)
        yield explained(folder.name, file, folder / file, columns, 0.95)


def _camber(folder: Path) -> Iterator[Prediction]:
    for path in sorted(folder.glob("*.txt")):
        columns = LogColumns("1", ("3",), ("4",))
        yield explained(folder.name, path.stem, path, columns, 0.95)


def _umich(folder: Path) -> Iterator[Prediction]:
    columns = LogColumns(None, ("X1_CommandPosition",), ("X1_ActualPosition",), "mm", 0.1)
    try:
        axis_of(folder / "experiment_11.csv", columns)
        said = "a model"
    except ValueError as error:
        said = str(error)
    slow = "too slow or too coarse" in said
    yield Prediction(folder.name, "X", "too slow and coarse to show dynamics", said, slow)


PREDICTED: dict[str, Callable[[Path], Iterator[Prediction]]] = {
    "emps": _emps,
    "sinumerik_ast": _sinumerik,
    "motor_bench": _motor_bench,
    "kuka": _kuka,
    "lorenz_servo": _servo,
    "ruler_robot": _ruler,
    "camber": _camber,
    "umich_cnc": _umich,
}

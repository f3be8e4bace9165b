"""`jcontour identify LOG`: a machine file from a log of any program.

What takes long to load is loaded behind what may refuse the log.
"""

from dataclasses import replace

import numpy as np

from jcontour.app.files.log_file import Log, LogColumns, read_log
from jcontour.app.files.log_table import of_accelerometer
from jcontour.app.flags.machines import Identify, Logged
from jcontour.app.plain_numbers import feed_words
from tuning.identification.linear.machine_record import MachineRecord

MOST_POLES, MOST_DELAY = 8, 40
DEMO_DT, DEMO_COUNT = 1e-3, 1e-6  # [s], [m] of an encoder
DEMO_LIMITS = (0.2, 0.2, 4.0)  # travel [m], speed [m/s], acceleration [m/s^2]
DEMO = {"X": (25e-3, 8e-3, 2e-3), "Y": (25e-3, 12e-3, 3e-3)}  # gain, time constant, delay


def command(flags: Identify) -> int:
    """Read, fit, check, store and print; exit code."""
    _check(flags)
    if flags.demo:
        flags = replace(flags, control_unit="V")
    if flags.data is not None and of_accelerometer(flags.data):
        from jcontour.app.commands.machines import identify_vibration

        return identify_vibration.command(flags)
    if flags.other is not None:
        raise ValueError(f"{flags.data}: is of no accelerometer (Klipper's); give one file")
    if flags.data is None:
        log, source = _simulated(flags.seed)
    else:
        log, source = log_of(flags), str(flags.data)
    record = MachineRecord(log.dt, flags.axes, log.command, log.position).checked()
    from tuning.identification.linear.machine import identify_machine

    machine = identify_machine(record, flags.most_order, flags.most_delay)
    from jcontour.app.commands.machines.identified_machine import kept

    return kept(flags, log, source, machine)


def _check(flags: Identify) -> None:
    if flags.demo == (flags.data is not None):
        raise ValueError("identify: needs a log, or --demo for simulated data, and not both")
    check_columns(flags)
    if not 1 <= flags.most_order <= MOST_POLES:
        raise ValueError(f"most-order: needs 1 to {MOST_POLES}, received {flags.most_order}")
    if not 0 <= flags.most_delay <= MOST_DELAY:
        raise ValueError(f"most-delay: needs 0 to {MOST_DELAY}, received {flags.most_delay}")
    force = flags.force_constant
    if force is not None and not (np.isfinite(force) and force > 0):
        raise ValueError(f"force-constant: needs to be above zero, received {force}")
    if flags.demo and flags.axes != tuple(DEMO):
        raise ValueError("axes: the simulated data have X and Y")


def check_columns(flags: Logged) -> None:
    """Refuse names, a period and a length that no log has."""
    if len(set(flags.axes)) != len(flags.axes) or len(flags.axes) not in (1, 2, 3):
        raise ValueError(
            f"axes: needs one to three different names, received {' '.join(flags.axes)}"
        )
    if flags.period_ms is not None and not (np.isfinite(flags.period_ms) and flags.period_ms > 0):
        raise ValueError(f"period-ms: needs to be above zero, received {flags.period_ms}")
    if not isinstance(flags.length_unit, str) and not 0 < flags.length_unit < np.inf:
        raise ValueError(f"length-unit: needs to be above zero, received {flags.length_unit}")


def log_of(flags: Logged, asked: bool = False) -> Log:
    """The log that the flags name; `asked` where its commands are positions."""
    assert flags.data is not None
    columns = LogColumns(
        flags.time_column,
        flags.command_columns,
        flags.position_columns,
        flags.length_unit,
        None if flags.period_ms is None else 1e-3 * flags.period_ms,
        asked,
    )
    return read_log(flags.data, flags.axes, columns)


def _simulated(seed: int) -> tuple[Log, str]:
    """A log of two drives that take a speed in V, while what `--excite` writes ran."""
    from jcontour.app.jobs.excitation import Excited, program
    from jcontour.linear.continuous_axes import sampled_axis, speed_axis

    random = np.random.default_rng(seed)
    asked = program(Excited(tuple(DEMO), DEMO_DT, *(np.full(2, one) for one in DEMO_LIMITS)))
    command, position = np.zeros_like(asked), np.zeros_like(asked)
    for axis, (gain, constant, delay) in enumerate(DEMO.values()):
        A, B, C, late = sampled_axis(speed_axis(gain, constant, delay), DEMO_DT)
        noise, shocks = random.standard_normal(len(asked)), random.standard_normal(len(asked))
        x, waiting, largest = np.zeros(len(A)), [0.0] * (late + 1), 0.0
        for k, wanted in enumerate(asked[:, axis]):  # a position loop of 60 / s
            place = DEMO_COUNT * np.round((C[0] @ x + 0.3e-6 * noise[k]) / DEMO_COUNT)
            u = 60.0 / gain * (wanted - place)
            largest = max(largest, abs(u))
            waiting = [u + 2e-3 * largest * shocks[k], *waiting[:-1]]
            x = A @ x + B[:, 0] * waiting[late]
            command[k, axis], position[k, axis] = u, place
    words = "simulated: " + "; ".join(
        f"{name} {feed_words(gain)} per V, {1e3 * constant:g} ms, {1e3 * delay:g} ms of delay"
        for name, (gain, constant, delay) in DEMO.items()
    )
    return Log(DEMO_DT, command, position, ()), f"{words}; encoders of 1 um, seed {seed}"

"""Flags of the commands that make a machine: from recorded data, or from what engineers know."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from jcontour.app.flags.shared import Common, MakesRun

LengthUnit = Literal["m", "mm", "um"]
PositionUnit = Literal["m", "mm", "um", "inch", "rad", "mrad", "deg", "rev"] | float
Takes = Literal["speed", "position", "force"]


@dataclass(frozen=True)
class Logged(MakesRun):
    """Columns of a log."""

    data: Positional[Path | None] = None
    """Log (CSV, netCDF, MAT) with a command and a position for each axis."""
    axes: tuple[str, ...] = ("X", "Y")
    """Names of one to three axes; their columns are x_command, x_position, ..."""
    time_column: str | None = None
    """Name of the column of time; time_ms and t_us say their unit.
    Without one, it is seconds where they are possible, else what suits a drive, and is printed."""
    command_columns: tuple[str, ...] = ()
    """Names of the commands, one per axis."""
    position_columns: tuple[str, ...] = ()
    """Names of the measured positions, one per axis."""
    length_unit: PositionUnit = "mm"
    """Unit of the positions, where their columns do not say (x_position_um); of counts a number,
    the metres of one."""
    period_ms: float | None = None
    """Sample period [ms]; a column of time is then not used."""


@dataclass(frozen=True)
class Audit(Logged):
    """Tell the contour error of a log, where it is largest, and why.

    Every cause has its share in um, and what to change on the control.
    """

    part: str | None = None
    """Part that was run, a toolpath or a name; errors are then those from the part.
    When not given, from the path of the commands."""


@dataclass(frozen=True)
class Identify(Logged):
    """Fit a machine to recorded data: a transfer function per axis, with delay and dry friction.

    A log of any program will do, in open or closed loop. Every number comes with its 95 % interval.
    Of the records of an accelerometer (Klipper's raw_data_*.csv, resonances_*.csv): resonances.
    """

    other: Positional[Path | None] = None
    """Record of an accelerometer while another axis is shaken, where the first file is one."""
    demo: bool = False  # a file is expected
    """Instead of a file, take simulated data with counted, noisy encoders.
    The file is kept in the run folder."""
    seed: int = 0  # any number: the same one repeats the data
    """Seed of the noise of --demo."""
    control_unit: str = "control unit"
    """Unit of the commands, for tables and figures."""
    most_order: int = 3  # a time constant and a resonance
    """Highest order of an axis beside its integrator, 1 to 8."""
    most_delay: int = 10  # samples; a fieldbus with three to spare
    """Longest delay that is looked for [samples], at most 40."""
    force_constant: float | None = None
    """Force [N], or torque [N m], of one unit of the command: masses and stiffness are printed."""
    response: Path | None = None
    """Instead: tune a PI control with filters on a measured frequency response (CSV with
    frequency_hz, real and imaginary or db and degrees, coherence; XML of a SINUMERIK)."""
    crossover_hz: float | None = None
    """response: crossover of the loop [Hz]; the highest with Ms of at most 1.5 when not given."""
    excite: Path | None = None
    """Instead: write programs (G-code, CSV) whose record shows what a tuner needs, within the
    limits of this JSON file: axes, travel, speed, acceleration, length_unit, dt."""


@dataclass(frozen=True)
class Machine(Common):
    """Write a machine file from what is known of its axes, or check and draw one.

    Give a transfer function or a data sheet axis by axis, or a step response of each.
    """

    file: Positional[Path | None] = None
    """Machine to check and draw: a file, or a name from `jcontour list`; a new one when not
    given."""
    example: Path | None = None
    """Write the machine file of an example here, to begin from: a mill with two axes."""
    axes: tuple[str, ...] = ("X", "Y")
    """Names of two or three axes. Where a flag below takes numbers, give one for all, or one for
    each."""
    takes: Takes = "speed"  # usual for a drive with a velocity loop
    """Meaning of the control. speed: K / (s (T s + 1)). position: K / (T s + 1).
    force: K / (M s^2 + F s)."""
    gain: tuple[float, ...] = ()
    """K: speed or position [length_unit (per s)] per unit of control, or force [N] per unit."""
    time_constant_ms: tuple[float, ...] = ()
    """T [ms]."""
    delay_ms: tuple[float, ...] = ()
    """Time before anything moves [ms]; it need not be whole samples."""
    resonance_hz: tuple[float, ...] = ()
    """Frequency of a resonance of the axis [Hz]; 0 for an axis without one."""
    damping: float = 0.03  # of a welded frame
    """Damping of the resonances; half of it is counted with, beside --resonance-uncertainty."""
    resonance_uncertainty: float = 0.05  # it moves with the place of the table and with the part
    """Part by which the frequencies of the resonances may be off: tuned loops stay stable, also if
    the response is off by twice as much as that makes it.
    0 takes frequency and damping for exact."""
    mass_kg: tuple[float, ...] = ()
    """Moving mass M [kg], where the drive takes a force."""
    viscous: tuple[float, ...] = ()
    """Viscous friction F [N s/m], where the drive takes a force."""
    steps: tuple[Path, ...] = ()
    """Step responses instead, a CSV for each axis: columns time [s], control, position.
    Any control that changes will do."""
    period_ms: float = 1.0  # usual for a motion controller
    """Sample period of the controller [ms]; step responses bring their own."""
    length_unit: LengthUnit = "mm"
    """Unit of lengths in these flags, in the step responses and in the file."""
    control_unit: str = "control unit"
    """Text for tables and figures, as V or mm/s."""
    max_control: tuple[float, ...] = ()
    """Limit on the control [control unit]."""
    max_speed: tuple[float, ...] = ()
    """Limit on the speed [length_unit/s]."""
    max_acceleration: tuple[float, ...] = ()
    """Limit on the acceleration [length_unit/s^2]."""
    gain_uncertainty: float | None = None
    """Every gain is known to this fraction. 0.1 when not given; 0 where the drive takes a
    position, since its own encoder sees to it that the axis gets there."""
    delay_uncertainty: int = 1  # a bus
    """Most samples of delay beyond those given."""
    encoder_um: tuple[float, ...] = (1.0,)  # usual for a linear encoder
    """Resolution of the encoders [um]; of rotary ones the pitch over the counts of a turn."""
    name: str = "machine"
    """Name of the machine."""
    out: Path | None = None
    """File to write; NAME.json when not given. It must not exist. Its name ends in .json, which is
    added where it is missing."""

"""Flags of `jcontour machine`: what engineers know of an axis."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from experiments.shared_options import Common

Takes = Literal["speed", "position", "force"]
LengthUnit = Literal["m", "mm", "um"]


@dataclass(frozen=True)
class Machine(Common):
    """Write a machine file from what is known of its axes, or check and draw one.

    Give a transfer function or a data sheet axis by axis, or a step response of each.
    """

    file: Positional[Path | None] = None
    """Machine to check and draw: a file, or a name from `jcontour list`; a new one when not
    given."""
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
    """Damping of the resonances."""
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
    max_control: float | None = None
    """Limit on every control [control unit]."""
    max_speed: float | None = None
    """Limit on the speed of every axis [length_unit/s]."""
    max_acceleration: float | None = None
    """Limit on the acceleration of every axis [length_unit/s^2]."""
    gain_uncertainty: float = 0.1  # a data sheet is seldom better
    """Every gain is known to this fraction."""
    delay_uncertainty: int = 1  # a bus
    """Most samples of delay beyond those given."""
    encoder_um: float = 1.0  # usual for a linear encoder
    """Resolution of the encoders [um]."""
    name: str = "machine"
    """Name of the machine."""
    out: Path | None = None
    """File to write; NAME.json when not given. It must not exist."""

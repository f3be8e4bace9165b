"""Pace of a machine along a path: feed, limits, the law by which it runs, what memory holds."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import psutil

from jcontour._arrays import check_above_zero
from jcontour.app.flags.shared import FeedLaw, MachineFlags, Planner
from jcontour.app.machines.machine import Machine
from jcontour.app.plain_numbers import MM_PER_MIN
from jcontour.geometry.toolpath_rules import GAP, INCH, MM

if TYPE_CHECKING:  # a contour at constant feed needs neither
    from jcontour.geometry.gcode.modes import Tool
    from jcontour.motion.other_controls import ControlLimits

FEED = 3000.0  # [mm/min] where nothing is programmed
DRAWING_UNITS = {
    "mm": MM,
    "cm": 10 * MM,
    "m": 1.0,
    "inch": INCH,
    "px": INCH / 96,
    "pt": INCH / 72,
}  # [m]
# [m/s^2] of a path where the machine states none: usual for a table of this size
ACCELERATION = 2.0
# of the acceleration that a machine states, that a motion asks for: fast loops take 1.8 times what
# a step of acceleration asks (`example.json`, its bracket and held-out contours, whole family)
SHARE = 0.5
# [bytes] of the program, and of a sample on one plant: 2.1 million samples of contouring-lq on five
# plants of `bridgeport` took 3.7 GB at most, 4.4 million took 6.8 GB
BEGUN, BYTES = 0.8e9, 270


class Pace(NamedTuple):
    """Feed [m/s] and path acceleration [m/s^2] on a machine with its limits.

    Each is None where it is not given.
    """

    machine: Machine
    feed: float | None
    acceleration: float | None
    feed_law: FeedLaw = "jerk"  # by which a programmed path is run
    jerk: float | None = None  # limit of every axis [m/s^3]; None where it is not given
    corner_tolerance: float = 2e-6  # of the jerk-limited law, from the path [m]; 0 stops in corners
    drawing_unit: float | None = None  # of a drawing [m]; None where its file has to say
    join: float = GAP  # ends of a drawing's lines within it are joined [m]
    # limits of a control, which the motion asks for in full; None for the machine's
    control: "ControlLimits | None" = None
    planner: Planner = "jcontour"  # control whose motion is predicted
    warnings: tuple[str, ...] = ()  # questions about the units of these limits
    tools: "dict[int, Tool] | None" = None  # of the tool table, by number; None without one
    override: float = 1.0  # share of every feed that is run, programmed or not; rapid moves stay

    @property
    def feed_or_default(self) -> float:
        """Feed [m/s] of contours that have no programme."""
        return FEED * MM_PER_MIN if self.feed is None else self.feed

    @property
    def acceleration_or_default(self) -> float:
        """Path acceleration [m/s^2]; where none is given, `axis_acceleration` of the weakest."""
        if self.acceleration is not None:
            return self.acceleration
        limit = self.axis_acceleration
        return ACCELERATION if limit is None else float(limit.min())

    @property
    def axis_acceleration(self) -> np.ndarray | None:
        """Acceleration [m/s^2] that a motion may ask of each axis; None where none is stated.

        All of the control's; of the machine's a half, or all where the path acceleration is given.
        """
        if self.control is not None:
            return np.minimum(self.control.acceleration, self.control.path_acceleration)
        limit = self.machine.limits.acceleration
        if limit is None or self.acceleration is not None:
            return limit
        return SHARE * limit

    @property
    def axis_speed(self) -> np.ndarray | None:
        """Greatest speed [m/s] of each axis; None where none is stated."""
        if self.control is not None:
            return np.minimum(self.control.speed, self.control.path_speed)
        return self.machine.limits.speed

    @property
    def halved(self) -> bool:
        """Whether a motion asks for a part of the stated acceleration alone."""
        stated = self.machine.limits.acceleration is not None
        return stated and self.control is None and self.acceleration is None

    @property
    def largest_jerk(self) -> float:
        """Jerk with which an axis builds up its acceleration within one sample [m/s^3]."""
        limit = self.axis_acceleration
        most = self.acceleration_or_default if limit is None else float(limit.max())
        return most / float(self.machine.model.dt)

    @classmethod
    def of(cls, flags: MachineFlags, machine: Machine) -> "Pace":
        """Pace that the flags ask for."""
        asked = {
            "feed-mm-per-min": flags.feed_mm_per_min,
            "acceleration": flags.acceleration,
            "jerk": flags.jerk,
            "junction-deviation-um": flags.junction_deviation_um,
        }
        check_above_zero(**{name: value for name, value in asked.items() if value is not None})
        feed = None if flags.feed_mm_per_min is None else flags.feed_mm_per_min * MM_PER_MIN
        for name, value in (
            ("corner-tolerance-um", flags.corner_tolerance_um),
            ("join-um", flags.join_um),
        ):
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name}: needs to be finite and not negative, received {value}")
        control, warnings = _control(flags, machine)
        tools = None
        if flags.tool_table is not None:
            from jcontour.geometry.gcode.modes import read_tool_table

            tools = read_tool_table(flags.tool_table)
        pace = cls(
            machine,
            feed,
            flags.acceleration,
            flags.feed_law,
            flags.jerk,
            corner_tolerance=1e-6 * flags.corner_tolerance_um,
            drawing_unit=None if flags.drawing_unit is None else DRAWING_UNITS[flags.drawing_unit],
            join=1e-6 * flags.join_um,
            control=control,
            planner=flags.planner,
            warnings=warnings,
            tools=tools,
        )
        if flags.jerk is not None and flags.jerk > pace.largest_jerk:
            raise ValueError(
                f"jerk: beyond {pace.largest_jerk:.4g} m/s^3 the acceleration builds up within a "
                f"sample and no limit remains, received {flags.jerk:g}"
            )
        return pace


def _control(
    flags: MachineFlags, machine: Machine
) -> "tuple[ControlLimits | None, tuple[str, ...]]":
    """Limits of the control that the flags name, and questions about them; None for none."""
    if flags.junction_deviation_um is not None and flags.planner != "grbl":
        raise ValueError("junction-deviation-um: --planner grbl alone has one")
    warnings: tuple[str, ...] = ()
    if flags.machine_limits is not None:
        from jcontour.app.files.control_limits import read_control_limits

        control, warnings = read_control_limits(Path(flags.machine_limits), machine.model.axes)
    elif flags.planner == "jcontour":
        return None, ()
    else:
        from jcontour.motion.other_controls import ControlLimits

        speed, acceleration = machine.limits.speed, machine.limits.acceleration
        if speed is None or acceleration is None:
            raise ValueError(
                f"planner: {machine.name} states no speed and acceleration of its axes; "
                "--machine-limits gives them"
            )
        control = ControlLimits(flags.planner, speed, acceleration)
    if flags.planner != "jcontour":
        control = control._replace(control=flags.planner)
    if flags.junction_deviation_um is not None:
        control = control._replace(junction_deviation=1e-6 * flags.junction_deviation_um)
    return control, warnings


class TooLongError(ValueError):
    """A motion whose samples do not fit into the free memory.

    Attributes:
        piece: number of the piece that takes longest.
    """

    def __init__(
        self, piece: int, seconds: float, dwells: float, z_alone: float, dt: float, most: int
    ):
        self.piece = piece
        of_them = f", {dwells:.3g} s of it in dwells (P of G4 is in seconds)" if dwells else ""
        of_them += f", {z_alone:.3g} s of it while Z moves alone" if z_alone else ""
        super().__init__(
            f"the program takes {seconds:.3g} s at least, longest here{of_them}; that is more than "
            f"the {most:,} samples of {dt:g} s that fit into the free memory: give a higher "
            f"feed{', shorter dwells' if dwells else ''} or a part of the program"
        )


def most_samples(plants: int) -> int:
    """Samples of a run on some plants that the free memory [bytes] holds, none below zero."""
    return max(int((free_memory() - BEGUN) // (BYTES * plants)), 0)


def free_memory() -> float:
    """Memory that programs may still take [bytes], without driving others out."""
    return float(psutil.virtual_memory().available)


def check_duration(
    moving: np.ndarray, dwelling: np.ndarray, z_alone: np.ndarray, machine: Machine
) -> None:
    """Refuse what takes so long [s] that its samples do not fit in memory."""
    lasting = moving + dwelling + z_alone
    whole, *resting = (float(np.sum(part)) for part in (lasting, dwelling, z_alone))
    dt, most = machine.model.dt, most_samples(len(machine.family_names))
    if whole / dt > most:
        raise TooLongError(int(np.argmax(lasting)), whole, *resting, dt, most)


def check_memory(name: str, samples: int, plants: int) -> None:
    """Refuse a run that does not fit into the free memory [bytes]."""
    there, takes = free_memory(), BEGUN + BYTES * samples * plants
    if takes > there:
        raise ValueError(
            f"{name}: {samples:,} samples on {plants} plants need about {1e-9 * takes:.0f} GB of "
            f"memory, {1e-9 * there:.0f} are free: give a higher feed or a part of the program"
        )

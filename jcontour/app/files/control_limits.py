"""Limits that a control is set to: LinuxCNC's INI, grbl's `$$` listing.

LinuxCNC: [AXIS_X] MAX_VELOCITY and MAX_ACCELERATION in [TRAJ] LINEAR_UNITS a second, [TRAJ]
MAX_LINEAR_VELOCITY, P of G64 in [RS274NGC] RS274NGC_STARTUP_CODE. grbl: $110 to $112 in mm a
minute, $120 to $122 in mm/s^2, $11 and $12 in mm.
"""

import configparser
import re
from pathlib import Path

import numpy as np

from jcontour.app.files.checks import MachineError, shown
from jcontour.app.plain_numbers import feed_words
from jcontour.geometry.toolpath_rules import INCH, MM, read_text
from jcontour.motion.other_controls import ControlLimits

SETTING = re.compile(r"(?m)^\s*\$(\d+)\s*=\s*([-+.\d]+)")
BLENDED = re.compile(r"G64\s*P\s*([.\d]+)", re.IGNORECASE)
LENGTHS = {"mm": MM, "metric": MM, "inch": INCH, "in": INCH, "imperial": INCH}
FAST = 2.0  # [m/s]: faster axes are rare, and mm/min read as mm/s look so
SLOW = 2e-3  # [m/s]: so slow a rapid move is none, and mm/s read as mm/min look so


def read_control_limits(path: Path, axes: int) -> tuple[ControlLimits, tuple[str, ...]]:
    """Limits of the first axes of X, Y and Z, and questions about their units.

    Raises:
        MachineError: the file is of neither, a limit is missing or no number, the axes
            are not the joints.
    """
    text, names = read_text(path), "XYZ"[:axes]
    settings = {int(key): value for key, value in SETTING.findall(text)}
    if settings:
        return _grbl(path, settings, names)
    parser = configparser.ConfigParser(
        strict=False, interpolation=None, inline_comment_prefixes=("#", ";"), allow_no_value=True
    )
    try:
        parser.read_string(re.sub(r"(?m)^#INCLUDE.*$", "", text))
    except configparser.Error as error:
        reason = str(error).splitlines()[0]
        raise MachineError(f"{path}: no INI or listing of grbl: {reason}") from None
    if parser.has_section("TRAJ") or parser.has_section("KINS"):
        return _linuxcnc(path, parser, names)
    raise MachineError(f"{path}: no [TRAJ] of a LinuxCNC INI, no $110=... of grbl")


def _number(path: Path, key: str, text: str | None, default: float | None = None) -> float:
    if text is None and default is not None:
        return default
    if text is None:
        raise MachineError(f"{path}: {key} is missing")
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not (np.isfinite(value) and value > 0):
        raise MachineError(f"{path}: {key} needs a number above 0, received {shown(text)}")
    return value


def _grbl(
    path: Path, settings: dict[int, str], names: str
) -> tuple[ControlLimits, tuple[str, ...]]:
    def setting(number: int, default: float | None = None) -> float:
        return _number(path, f"${number}", settings.get(number), default)

    rates = [setting(110 + k) for k in range(len(names))]
    gains = [setting(120 + k) for k in range(len(names))]
    limits = ControlLimits(
        "grbl",
        MM / 60 * np.array(rates),
        MM * np.array(gains),
        junction_deviation=MM * setting(11, 0.010),
        arc_tolerance=MM * setting(12, 0.002),
    )
    slow = [
        f"${110 + k} = {rate:g} is read as mm/min, {rate / 60:.3g} mm/s: is it mm/s?"
        for k, rate in enumerate(rates)
        if MM / 60 * rate < SLOW
    ]
    return limits, tuple(slow)


def _linuxcnc(
    path: Path, parser: configparser.ConfigParser, names: str
) -> tuple[ControlLimits, tuple[str, ...]]:
    kinematics = parser.get("KINS", "KINEMATICS", fallback="trivkins") or ""
    if not kinematics.split() or kinematics.split()[0] != "trivkins":
        raise MachineError(
            f"{path}: [KINS] KINEMATICS = {shown(kinematics)}: its joints are not its axes; only "
            "trivkins is planned"
        )
    unit = (parser.get("TRAJ", "LINEAR_UNITS", fallback=None) or "").lower()
    if unit not in LENGTHS:
        raise MachineError(f"{path}: [TRAJ] LINEAR_UNITS needs mm or inch, received {shown(unit)}")
    length = LENGTHS[unit]

    def setting(section: str, key: str, default: float | None = None) -> float:
        text = parser.get(section, key, fallback=None)
        return length * _number(path, f"[{section}] {key}", text, default)

    speed = {
        f"[AXIS_{name}] MAX_VELOCITY": setting(f"AXIS_{name}", "MAX_VELOCITY") for name in names
    }
    started = parser.get("RS274NGC", "RS274NGC_STARTUP_CODE", fallback="") or ""
    blended = BLENDED.search(started)
    limits = ControlLimits(
        "linuxcnc",
        np.array(list(speed.values())),
        np.array([setting(f"AXIS_{name}", "MAX_ACCELERATION") for name in names]),
        path_speed=setting("TRAJ", "MAX_LINEAR_VELOCITY", np.inf),
        tolerance=length * float(blended[1]) if blended else None,
    )
    read = "mm/s" if length == MM else "inches a second"
    return limits, tuple(
        f"{key} = {one / length:g} is read as {read}, {feed_words(one)}: is it a minute's, "
        "as in grbl?"
        for key, one in speed.items()
        if one > FAST  # nearly no axis has that
    )

"""`jcontour check RUN`: a stored run under limits, its largest error proven, or in LinuxCNC."""

from dataclasses import fields

from jcontour.app.commands.loops import check_bound, check_in_linuxcnc, check_limits
from jcontour.app.flags.loops import Check

OF_LIMITS = ("max_control", "max_increment", "max_speed_mm_s", "max_acceleration")
OF_LIMITS += ("fallback", "solver")
OF_BOUND = ("force", "encoder_um", "cells")


def command(flags: Check) -> int:
    """The check that is asked for; exit code.

    Raises:
        ValueError: a flag of another check is given, or as the check.
    """
    if flags.bound and flags.in_linuxcnc:
        raise ValueError("check: --in-linuxcnc does not go with --bound")
    kind = "bound" if flags.bound else "in-linuxcnc" if flags.in_linuxcnc else ""
    defaults = {one.name: one.default for one in fields(Check)}
    for name in (*OF_LIMITS, *OF_BOUND):
        mine = name in OF_BOUND if flags.bound else name in OF_LIMITS and not flags.in_linuxcnc
        if getattr(flags, name) != defaults[name] and not mine:
            other = f"does not go with --{kind}" if kind else "needs --bound"
            raise ValueError(f"check: --{name.replace('_', '-')} {other}")
    if flags.in_linuxcnc:
        return check_in_linuxcnc.command(flags)
    return check_bound.command(flags) if flags.bound else check_limits.command(flags)

"""`jcontour check RUN`: a stored run under the machine's limits, or its largest error proven."""

from dataclasses import fields

from jcontour.app.commands.loops import check_bound, check_limits
from jcontour.app.flags.loops import Check

OF_LIMITS = ("max_control", "max_increment", "max_speed_mm_s", "max_acceleration")
OF_LIMITS += ("fallback", "solver")
OF_BOUND = ("force", "encoder_um", "cells")


def command(flags: Check) -> int:
    """The check that is asked for; exit code.

    Raises:
        ValueError: a flag of the other check is given, or as the check.
    """
    defaults = {one.name: one.default for one in fields(Check)}
    for name in OF_LIMITS if flags.bound else OF_BOUND:
        if getattr(flags, name) != defaults[name]:
            other = "does not go with --bound" if flags.bound else "needs --bound"
            raise ValueError(f"check: --{name.replace('_', '-')} {other}")
    return check_bound.command(flags) if flags.bound else check_limits.command(flags)

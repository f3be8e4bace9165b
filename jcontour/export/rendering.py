"""The text of a streaming law: its constants and its step, put into templates.

One step, `templates/step.j2`, is written in statements that C, Python and structured text share.
C takes it as it is, `languages` turns it into the others: all three compute the same sums in the
same order.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jinja2
import numpy as np

from jcontour.controllers.feedback.cascade import STANDS
from jcontour.export.code_text import (
    Precision,
    in_c,
    in_python,
    in_structured_text,
    literal,
    plain,
    table,
)
from jcontour.export.safe_limits import SafeLimits
from jcontour.export.streaming_law import StreamingLaw

LARGEST = 1e30  # stands for infinite: products with it are finite in single precision
SLACK = {"double": 1e-9, "single": 1e-6}  # of the speed limit: rounding of a reference at the limit
CRAWL = 1e-3  # of the speed of recovery: it ends
TYPES: dict[Precision, tuple[str, str]] = {  # in C and in structured text
    "double": ("double", "LREAL"),
    "single": ("float", "REAL"),
}
STATUSES = {
    "LAW_OFF": "not enabled",
    "LAW_FOLLOWING": "on the path",
    "LAW_RECOVERING": "on the way back to the path",
    "LAW_SLOWED": "a hold begins or ends",
    "LAW_HELD": "stands on the path",
    "LAW_TRIPPED": "stopped by a fault: law->trip says which",
}
TRIPS = {
    "LAW_NO_TRIP": "none",
    "LAW_FOLLOWING_ERROR": "an axis is too far from its command",
    "LAW_MEASUREMENT_LOST": "no number, or a jump, for too long",
    "LAW_MEASUREMENT_FROZEN": "a measurement stays while its axis is commanded to move",
    "LAW_REFERENCE": "the reference is no number, or faster than the speed limit",
    "LAW_OUT_OF_REACH": "the axes are too far from the path",
    "LAW_DEADLINE": "too many samples without a call",
    "LAW_NO_NUMBER": "the control is no number",
}
Constant = tuple[str, np.ndarray, str]


@dataclass(frozen=True)
class Code:
    """A law with its limits, and what its head says.

    Attributes:
        law: the law.
        limits: that it keeps.
        notes: lines for people, any text.
        unit: of the control.
        precision: of all numbers.
    """

    law: StreamingLaw
    limits: SafeLimits
    notes: Sequence[str]
    unit: str
    precision: Precision = "double"

    def text(self, template: str, **more: Any) -> str:
        """Text of a template of this package."""
        text = self._templates.get_template(template).render(**self._context, **more)
        return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Whole numbers of the law, by name."""
        law = self.law
        counts = {
            "LAW_AXES": law.axes,
            "LAW_MEASURED": law.measured,
            "LAW_INPUTS": law.inputs,
            "LAW_PREVIEW": law.preview,
            "LAW_WINDOW": law.preview + 1,
            "LAW_POINTS": law.points,
        }
        if law.states:
            counts["LAW_STATES"] = law.states
        if law.behind:
            counts["LAW_BEHIND"] = law.behind
        if law.window is not None:
            counts["LAW_MODEL"] = len(law.window.A)
            counts["LAW_HORIZON"] = len(law.window.stage)
        else:
            assert law.G is not None
            counts["LAW_FILTER"] = len(law.G)
        if self._holds:
            counts["LAW_STOOD"] = law.hold_after
        counts["LAW_WAIT"] = law.dead_time + self.limits.wait
        counts["LAW_IDLE"] = law.dead_time + self.limits.idle
        counts["LAW_MOST_LOST"] = self.limits.lost
        counts["LAW_MOST_MISSED"] = self.limits.missed
        return counts

    @cached_property
    def constants(self) -> list[Constant]:
        """Tables of numbers: name, values, meaning."""
        law, safe, dt = self.law, self.limits, self.law.dt
        recovery, speed_up = safe.recovery_speed * dt, safe.recovery_acceleration * dt**2
        position = np.isfinite(safe.jump)
        freeze = np.where(position, np.abs(law.places).T @ safe.freeze, np.inf)
        tables: list[tuple[str, np.ndarray | None, str]] = [
            ("LAW_LIMIT", law.limit, "of every control, +-"),
            ("LAW_INCREMENT", safe.increment, "of every control in a sample, +-"),
            ("LAW_SPEED", safe.speed * dt * (1 + SLACK[self.precision]), "m in a sample"),
            ("LAW_RECOVERY", recovery, "way back to the path, m in a sample"),
            ("LAW_SPEED_UP", speed_up, "its acceleration, m in a sample squared"),
            ("LAW_DECAY", speed_up / recovery, "its end: part of the way left, in a sample"),
            ("LAW_CRAWL", CRAWL * recovery, "m in a sample: it ends"),
            ("LAW_REACH", safe.reach, "m from the path where it may be enabled"),
            ("LAW_NEAR", safe.near, "m from the path that need no way back"),
            ("LAW_FOLLOWING_LIMIT", safe.following, "m from the command that trip"),
            ("LAW_JUMP", safe.jump, "of a measurement in a sample that is not believed"),
            ("LAW_FREEZE", freeze, "m commanded without a change of the measurement that trip"),
            (
                "LAW_PUSH",
                safe.push,
                "of the control, that trips where a measurement stays for LAW_WAIT samples",
            ),
            ("LAW_NUDGE", safe.nudge, "likewise, for LAW_IDLE samples"),
            ("LAW_DRIVES", law.drives, "control behind a measurement: measured x controls"),
            ("LAW_PLACES", law.places, "positions in a measurement: axes x measured"),
            ("LAW_SEEN", law.seen, "measurement at rest: measured x axes"),
            ("LAW_HOLD", law.hold if law.base == "start" else None, "control at rest"),
            ("LAW_A", law.A, "memory x memory"),
            ("LAW_B", law.B, "memory x controls"),
            ("LAW_E", law.E, "memory x measured"),
            ("LAW_W", law.W, "references, memory x axes for each"),
            ("LAW_L", law.L, "observer gain: memory x measured"),
            ("LAW_C", law.C, "measured part of the memory"),
            ("LAW_F", law.F, "gain: controls x memory"),
            ("LAW_D", law.D, "gain: controls x measured"),
            ("LAW_INTEGRAL", law.integral, "1 for integrals in the memory"),
            ("LAW_DRY", law.dry, "against friction: controls x axes"),
            ("LAW_SLEW", law.slew, "most that this changes in a sample"),
            ("LAW_G", law.G, "references, controls x axes for each"),
        ]
        if law.states:
            still = None if law.base == "start" else law.still
            tables.append(("LAW_STILL", still, "memory at rest: memory x axes"))
            tables.append(("LAW_ENTRY", law.entry, "memory in motion: memory x axes"))
            kept = law.kept if np.isfinite(law.kept).any() else None
            tables.append(("LAW_KEPT", kept, "of the memory, +-"))
        if law.window is not None:
            tables += [
                ("LAW_BACK", law.window.A.T, "model, transposed"),
                ("LAW_ENTER", law.window.B.T, "its inputs, one in a row"),
                ("LAW_OUTPUT", law.window.C, "its outputs"),
                ("LAW_SQUARE", law.window.C.T @ law.window.C, "C' C"),
                ("LAW_MIX", law.window.inputs, "controls of its inputs"),
                ("LAW_WEIGHT", law.window.weight, "of every input"),
                ("LAW_STAGE", law.window.stage, "profile over the samples ahead"),
                ("LAW_TERMINAL", law.window.H, "cost at the end"),
                ("LAW_AT", law.window.at, "state of a steady motion per position"),
                ("LAW_PER", law.window.per, "likewise, per increment"),
            ]
        return [
            (name, np.where(np.isfinite(values), values, LARGEST), words)
            for name, values, words in tables
            if values is not None
        ]

    @cached_property
    def scalars(self) -> list[tuple[str, float, str]]:
        """Single numbers: name, value, meaning."""
        values = [
            ("LAW_LARGEST", LARGEST, "of a number"),
            ("LAW_SLOWING", min(1.0, self.law.dt / self.limits.stop), "of a hold, in a sample"),
        ]
        if self.law.window is not None:
            values.append(("LAW_TOTAL", self.law.window.total, "weight on an error, 1/m2"))
            values.append(("LAW_BETA", self.law.window.beta, "forgiven along the path, 1/m2"))
        if self.law.dry is not None:
            values.append(("LAW_STANDS", STANDS, "m in a sample: the reference stands"))
        return values

    @cached_property
    def memory(self) -> list[tuple[str, str, str]]:
        """Numbers that are remembered: name, size, meaning."""
        fields = [("control", "LAW_INPUTS", "that acts until the next sample")]
        if self.law.states:
            fields.append(
                ("state", "LAW_STATES", ", ".join(plain(name) for name in self.law.names))
            )
        fields += [
            ("base", "LAW_AXES", "what positions count from"),
            ("command", "LAW_AXES", "where the axes were meant to be"),
            ("expected", "LAW_AXES", "reference point of the next sample"),
            ("offset", "LAW_AXES", "of the command from the path"),
            ("creep", "LAW_AXES", "way back in the last sample"),
            ("seen", "LAW_MEASURED", "last measurement that was believed"),
            ("departure", "LAW_MEASURED", "of it from that on the command"),
            ("frozen", "LAW_MEASURED", "way commanded since it changed"),
            ("rested", "LAW_MEASURED", "control behind it when it changed"),
            ("rate", "", "of reading on: 1, less in a hold"),
            ("phase", "", "between two reference points"),
        ]
        if self.law.dry is not None:
            fields.append(("sliding", "LAW_INPUTS", "part of the control, against friction"))
        if self.law.behind:
            fields.append(("past", "LAW_BEHIND * LAW_AXES", "commands of the samples before"))
        return fields

    @property
    def counters(self) -> list[tuple[str, str, str]]:
        """Whole numbers that are remembered: name, size, meaning."""
        return [
            ("status", "", "see above"),
            ("trip", "", "see above"),
            ("take", "", "reference points to pass on"),
            ("called", "", "tick of the last call"),
            ("timed", "", "whether there was one"),
            ("unread", "LAW_MEASURED", "samples since a measurement was believed"),
            ("idle", "LAW_MEASURED", "samples that its control pushes without a change"),
            ("losses", "", "measurements that were not believed"),
            ("missed", "", "samples without a call"),
            ("breaks", "", "samples at which the reference was not the one announced"),
            *([("stood", "", "samples for which the reference stands")] if self._holds else []),
        ]

    @property
    def _holds(self) -> bool:
        """Whether integrals are held at standstill."""
        return self.law.integral is not None

    @cached_property
    def arrays(self) -> list[tuple[str, str]]:
        """Arrays of one call: name and size."""
        law = self.law
        buffers = [("window", "LAW_WINDOW * LAW_AXES"), ("reading", "LAW_MEASURED")]
        buffers += [("place", "LAW_AXES"), ("increment", "LAW_AXES"), ("away", "LAW_AXES")]
        buffers += [("rest", "LAW_INPUTS"), ("wanted", "LAW_INPUTS")]
        if law.states:
            buffers.append(("ahead", "LAW_STATES"))
        if law.B is not None:
            buffers.append(("acting", "LAW_INPUTS"))
        if law.dry is not None:
            buffers.append(("against", "LAW_INPUTS"))
        if law.L is not None:
            buffers.append(("miss", "LAW_MEASURED"))
        if self._holds:
            buffers.append(("held", "LAW_STATES"))
        if law.window is None:
            return [*buffers, ("filtered", "LAW_FILTER * LAW_AXES")]
        square = "LAW_MODEL * LAW_MODEL"
        buffers += [("along", "LAW_WINDOW * LAW_AXES"), ("toward", "LAW_AXES")]
        buffers += [("cost", square), ("half", square), ("gain", "LAW_INPUTS * LAW_MODEL")]
        buffers += [(name, "LAW_MODEL") for name in ("slope", "bend", "point")]
        return [*buffers, ("feed", "LAW_INPUTS")]

    @cached_property
    def numbers(self) -> list[str]:
        """Single numbers of one call."""
        names = ["part", "pace", "gap", "beside", "speed", "here", "spare", "shown", "moved"]
        return [*names, "change", "push", *(["whole", "size"] if self.law.window else [])]

    @cached_property
    def _templates(self) -> jinja2.Environment:
        environment = jinja2.Environment(
            loader=jinja2.PackageLoader("jcontour.export"),
            trim_blocks=True,
            lstrip_blocks=True,
            keep_trailing_newline=True,
            undefined=jinja2.StrictUndefined,
        )
        precision = self.precision
        environment.filters |= {
            "number": lambda value, kind=None: literal(value, kind or precision),
            "table": lambda values, kind=None: table(values, kind or precision),
            "code": lambda text: in_c(text, precision),
            "python": in_python,
            "structured": in_structured_text,
        }
        return environment

    @cached_property
    def _context(self) -> dict[str, Any]:
        names = "sizes constants scalars memory counters arrays numbers unit".split()
        context = {name: getattr(self, name) for name in names}
        law = self.law
        context["law"] = law
        context["clamped"] = bool(law.states) and bool(np.isfinite(law.kept).any())
        context["statuses"], context["trips"] = STATUSES, TRIPS
        context["real"], context["type"] = TYPES[self.precision]
        context["notes"] = "\n".join(f" * {plain(line)}".rstrip() for line in self.notes)
        safe = [plain(line).replace('"""', "'''") for line in self.notes]
        context["lines"] = [line.replace("\\", "/") for line in safe]
        for name in ("start", "step"):
            context[name] = self._templates.get_template(f"{name}.j2").render(**context)
        return context

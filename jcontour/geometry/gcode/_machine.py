"""A machine control that carries out words line by line: modal state, and the moves it has made."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from jcontour.geometry.gcode import _words as codes
from jcontour.geometry.gcode._compensation import Compensation, diameter_of
from jcontour.geometry.gcode._expressions import whole
from jcontour.geometry.gcode._words import LineWords, sorted_words
from jcontour.geometry.gcode.modes import (
    SYSTEMS,
    ZERO,
    Modes,
    Offsets,
    Point,
    Tool,
    replaced,
    tool_numbered,
)
from jcontour.geometry.gcode.moves import (
    MOST_TURNS,
    PLANES,
    Move,
    Tracer,
    arcs_of,
    check_near,
)
from jcontour.geometry.toolpath_rules import FASTEST, INCH, MM, SHORTEST, SLOWEST, ToolpathError

AXES = {"X": 0, "Y": 1, "Z": 2}
MOVING = frozenset("XYZIJKR")
LENGTHS = frozenset("XYZIJKRQ")
UNUSED = frozenset("ABCDEHSTUVW$")  # letters without meaning for the path
UNUSED_WITH_CODES = frozenset("LPQ")  # of codes without meaning for it
MM_PER_MIN = MM / 60.0  # [m/s]
PECK_CLEARANCE = 0.01 * INCH  # [m] above the bottom of before, where feeding begins again
MOST_PECKS = 10_000  # of a hole
DWELLING = frozenset({740, 820, 840, 860, 880, 890})  # at the bottom of a hole
RANGE = f"{SLOWEST / MM_PER_MIN:g} to {FASTEST / MM_PER_MIN:.0f} mm/min"


@dataclass
class Machine:
    """The modal state of a machine control, and the moves it has made."""

    tracer: Tracer  # where the machine is, and the moves it has made
    # in force at the beginning [m/s]; None where the program has to give one
    first_feed: float | None
    tools: dict[int, Tool] | None = None  # of the tool table, by number; None without one
    modes: Modes = field(default_factory=Modes)
    offsets: Offsets = field(default_factory=Offsets)
    motion: int | None = None  # code in force, in tenths
    begun: bool = False  # whether the program has said what is in force
    assumed_at: int = 0  # line of a first move without a motion code; 0 where there is none
    homes: dict[int, Point] = field(default_factory=lambda: {280: ZERO, 300: ZERO})
    tool: int = 0  # in the spindle
    next_tool: int = 0
    ended: bool = False
    ignored: set[str] = field(default_factory=set)  # words without meaning for the path
    skipped: dict[tuple[str, int], int] = field(default_factory=dict)  # / lines by file and index
    tolerance: float | None = None  # the smallest P of G64, from the path [m]
    sticky: dict[str, float] = field(default_factory=dict)  # Z, R, Q [m] and P [s] of a cycle
    level_before_cycles: float | None = None
    compensation: Compensation | None = None

    @property
    def at(self) -> Point:
        """Programmed place on the machine [m], from which the tool is off under compensation."""
        return self.tracer.at if self.compensation is None else self.compensation.at

    @property
    def moves(self) -> list[Move]:
        """Moves made so far."""
        return self.tracer.moves

    def __post_init__(self) -> None:
        self.modes.feed = self.first_feed

    def execute(self, words: Sequence[tuple[str, float]]) -> LineWords:
        """Carry out the words of a line; return them sorted."""
        line = sorted_words(words, self.motion)
        values = line.values
        if line.codes or line.m_codes or line.without_motion:
            if self.compensation is not None:
                self.compensation.check(line, self.modes.plane)
            self._switch(line)
        if not codes.STOPPING.isdisjoint(line.m_codes):
            self._stop(line.m_codes, codes.STOPPING)
        if "F" in values:
            # F in units per minute; a given feed replaces what no machine can run
            word = values["F"]
            feed, unit = word * self.modes.unit / 60.0, self.modes.unit
            in_range = SLOWEST <= feed <= FASTEST
            if self.first_feed is not None and word >= 0 and not in_range:
                feed = self.first_feed
            elif not (feed == 0 or in_range):
                received = f"F{word:.10g}" if unit == MM else f"F{word:.10g} in inches"
                raise ToolpathError(
                    f"the feed needs to be {RANGE}, received {received}; --feed-mm-per-min gives "
                    "another"
                )
            self.modes.feed = feed
        unused = set(UNUSED)
        if line.codes.get("compensation", 400) != 400:
            unused.discard("D")
        if self.tools is not None and line.codes.get("tool length") == 430:
            unused.discard("H")
        self.ignored |= values.keys() & unused
        if not codes.FLOW.isdisjoint(line.m_codes):
            return line
        once = line.codes.get("once")
        if once in codes.SHIFTING and (once > 920 or not AXES.keys().isdisjoint(values)):
            self.tracer.stop(f"G{once / 10:g}")
        if once is not None and once != 530:
            self._do_once(once, values)
        if once not in codes.TAKING_AXES and once != 40:
            if not MOVING.isdisjoint(values) and not self._only_said(line):
                self._move(values, on_machine=once == 530)
        if not codes.PAUSES.isdisjoint(line.m_codes):
            self._stop(line.m_codes, codes.PAUSES)
        if not codes.END.isdisjoint(line.m_codes):
            self.ended = True
        return line

    def _stop(self, m_codes: list[int], stopping: frozenset[int]) -> None:
        """Come to rest once for all M codes of a line that ask for it."""
        self.tracer.stop(" ".join(f"M{code}" for code in m_codes if code in stopping))

    def _switch(self, words: LineWords) -> None:
        switched = words.codes
        if "T" in words.values:
            self.next_tool = int(words.values["T"])
        if 6 in words.m_codes:
            self.tool = self.next_tool
        self.modes.switch(switched)
        self._tell_codes(words)
        if "system" in switched:
            code = switched["system"]
            # Put a work system in force; another one than before waits for the motion
            system = (code - 530) // 10 if code <= 590 else code - 584
            if system != self.offsets.system:
                self.tracer.stop(f"G{53 + system}" if system <= 6 else f"G59.{system - 6}")
            self.offsets.system = system
        length = switched.get("tool length")
        if length is not None:
            self.tracer.stop(f"G{length / 10:g}")
        number = int(words.values.get("H", self.tool))
        if length == 430 and self.tools is not None and number:
            self.offsets.tool = tool_numbered(self.tools, number).offset
        elif length == 431:
            self.offsets.tool = replaced(self.offsets.tool, self._by_axis(words.values))
            for letter in AXES:
                words.values.pop(letter, None)
        elif length is not None:
            self.offsets.tool = ZERO
        if "motion" in switched:
            code = switched["motion"]
            self.motion = None if code == codes.NO_MOTION else code
            self.begun = True
            if code not in codes.CYCLES:
                self.level_before_cycles = None
                self.sticky = {}
        if "compensation" in switched:
            code = switched["compensation"]
            if code != 400:
                diameter = diameter_of(code, words.values, self.modes, self.tool, self.tools)
                offset = (0.5j if code < 420 else -0.5j) * diameter
                line = self.tracer.line
                self.compensation = Compensation(self.tracer, offset, self.at, line, code)
            elif self.compensation is None:
                self.ignored.add("G40")
            else:
                self.compensation.leaving = True

    def _tell_codes(self, line: LineWords) -> None:
        """Keep words without meaning for the path, and P of G64, the distance allowed from it."""
        self.ignored |= {f"G{code / 10:g}" for code in line.without_motion}
        self.ignored |= {f"M{code}" for code in line.m_codes if code not in codes.FLOW | codes.END}
        if line.codes.get("tool length") == 430 and self.tools is None:
            self.ignored.add("G43")
        blends = line.codes.get("path") == 640
        allowed = line.values.get("P", 0.0) * self.modes.unit if blends else 0.0
        if allowed > 0:
            self.tolerance = allowed if self.tolerance is None else min(allowed, self.tolerance)
        elif blends:
            self.ignored.add("G64")
        if blends or line.without_motion or not codes.FLOW.issuperset(line.m_codes):
            kept = {"P"} if allowed > 0 else set()
            self.ignored |= (line.values.keys() & UNUSED_WITH_CODES) - kept

    def _only_said(self, line: LineWords) -> bool:
        """Whether R belongs to a code that moves nothing, as in `M19 R90` and `G64 P1 R2`."""
        alone = MOVING.intersection(line.values) == {"R"} and "motion" not in line.codes
        said = alone and bool(line.without_motion or line.m_codes or "path" in line.codes)
        if said:
            self.ignored.add("R")
        return said

    def _do_once(self, code: int, values: dict[str, float]) -> None:
        offsets = self.offsets
        match code:
            case 40:  # axis words beside P are a move after it; X without P is the time
                word = "P" if "P" in values else "X"
                if word in values:
                    self.tracer.dwell(values[word], word)
                else:
                    self.ignored.add("G4")
                if word == "P" and not MOVING.isdisjoint(values):
                    self._move(values, on_machine=False)
            case 100:
                self._set_up(values)
            case 280 | 300:
                # G28 and G30: at traverse by way of a point, where one is given, to a place kept
                home, given = self.homes[code], AXES.keys() & values.keys()
                if given:
                    self._trace_line(self.offsets.on_machine(self._target(values)), rapid=True)
                    place = self.offsets.in_program(home)
                    by_axis = {AXES[letter]: place[AXES[letter]] for letter in given}
                    home = self.offsets.on_machine(
                        replaced(self.offsets.in_program(self.at), by_axis)
                    )
                self._trace_line(home, rapid=True)
            case 281 | 301:
                self.homes[code - 1] = self.at
            case 520:
                offsets.shift = offsets.kept_shift = replaced(offsets.shift, self._by_axis(values))
                offsets.shifted = True
            case 920:
                offsets.shift_to(self._by_axis(values), self.at)
            case 923:
                offsets.shift, offsets.shifted = offsets.kept_shift, True
            case _:
                offsets.shift, offsets.shifted = ZERO, False
                if code == 921:
                    offsets.kept_shift = ZERO

    def _set_up(self, values: dict[str, float]) -> None:
        """G10 L2 and L20 place a work system; other L set up tools, which have no length here."""
        kind = values.get("L")
        if kind not in (2, 20):
            self.ignored.add("G10")
            self.tracer.stop("G10")
            return
        system = whole(values.get("P", 0.0), "P of G10") or self.offsets.system
        if not 1 <= system <= SYSTEMS:
            raise ToolpathError(f"G10 needs P0 to P{SYSTEMS}, received P{system}")
        if system == self.offsets.system:
            self.tracer.stop("G10")
        lengths = self._by_axis(values)
        if kind == 20:
            self.offsets.set_here(system, lengths, self.at)
            return
        self.offsets.origins[system - 1] = replaced(self.offsets.origins[system - 1], lengths)
        if "R" in values:
            self.offsets.angles[system - 1] = math.radians(values["R"])

    def _by_axis(self, values: dict[str, float]) -> dict[int, float]:
        unit = self.modes.unit
        lengths = {i: values[letter] * unit for letter, i in AXES.items() if letter in values}
        check_near(lengths.values())
        return lengths

    def _move(self, values: dict[str, float], on_machine: bool) -> None:
        if "E" in values:
            raise ToolpathError(f"E feeds a filament in a move: {codes.NO_PRINTERS}")
        if self.motion is None:  # it begins in G0 as grbl and Mach3 do; G80 leaves nothing in force
            if self.begun or AXES.keys().isdisjoint(values):
                raise ToolpathError(
                    "axis words without a motion mode (G0, G1, G2 or G3, a cycle) before them"
                )
            self.motion, self.assumed_at = 0, self.tracer.line
        motion = self.motion
        if on_machine:
            if motion not in (0, 10):
                raise ToolpathError("G53 needs G0 or G1")
            end = replaced(self.at, self._by_axis(values))
            self._trace_line(end, motion == 0)
        elif motion in codes.CYCLES:
            self._drill(motion, values)
        elif motion > 10:
            self._arc(values)
        elif not values.keys().isdisjoint("IJKR"):
            raise ToolpathError(f"I, J, K and R belong to arcs (G2, G3), not to G{motion // 10}")
        else:
            self._trace_line(self.offsets.on_machine(self._target(values)), motion == 0)

    def _target(self, values: dict[str, float]) -> Point:
        """End point in the program that the letters X, Y and Z say [m]."""
        here, unit = self.offsets.in_program(self.at), self.modes.unit
        from_here = here if self.modes.incremental else ZERO
        x, y, z = (
            values[letter] * unit + from_here[axis] if letter in values else here[axis]
            for letter, axis in AXES.items()
        )
        check_near((x, y, z))
        return x, y, z

    def _arc(self, values: dict[str, float]) -> None:
        here, there = self.offsets.in_program(self.at), self._target(values)
        arcs = arcs_of(values, here, there, self.modes, counter_clockwise=self.motion == 30)
        plane = self.modes.plane
        _, _, normal = PLANES[plane]
        if normal < 2 and self.offsets.angle:
            raise ToolpathError(
                f"an arc in the plane of G{plane // 10} in a rotated work system is not supported"
            )
        rise = there[normal] - here[normal]
        turned = sum(abs(angle) for _, _, angle in arcs)
        slope = rise / turned if abs(rise) >= SHORTEST else 0.0
        feed = self._feed()
        level = here[normal]
        for end, centre, angle in arcs:
            middle = self.offsets.on_machine(_in_space(plane, centre, level))
            level += slope * abs(angle)
            self._trace(self.offsets.on_machine(_in_space(plane, end, level)), middle, angle, feed)
        self._joint()

    def _drill(self, code: int, values: dict[str, float]) -> None:
        """A canned cycle at every hole that the line says."""
        # incremental, R counts from the level before the cycles, and the bottom from R
        normal = PLANES[self.modes.plane][2]
        axis, incremental, sticky = "XYZ"[normal], self.modes.incremental, self.sticky
        if not values.keys().isdisjoint("IJK"):
            raise ToolpathError(
                "I, J and K do not belong to a canned cycle; L is a number of holes"
            )
        lengths = {letter: values[letter] * self.modes.unit for letter in LENGTHS & values.keys()}
        check_near(lengths.values())
        sticky |= {letter: lengths[letter] for letter in (axis, "R", "Q") if letter in lengths}
        if "P" in values:
            sticky["P"] = values["P"]
        for letter in (axis, "R"):
            if letter not in sticky:
                raise ToolpathError(f"a canned cycle needs {letter}")
        here = self.offsets.in_program(self.at)
        if self.level_before_cycles is None:
            self.level_before_cycles = here[normal]
        before = self.level_before_cycles
        retract = sticky["R"] + (before if incremental else 0.0)
        bottom = sticky[axis] + (retract if incremental else 0.0)
        if retract < bottom:
            raise ToolpathError("R of a canned cycle lies below the bottom of the hole")
        clear = retract if self.modes.to_r_plane else max(before, retract)
        holes = whole(values.get("L", 1.0), "L of a cycle")
        if not 1 <= holes <= MOST_TURNS:
            raise ToolpathError(f"L of a cycle needs to be 1 to {MOST_TURNS}, received {holes}")
        if here[normal] < retract:
            self._go_to_level(retract, rapid=True)
        above = here[normal] > retract + SHORTEST
        for index in range(holes):
            place = self._target({k: v for k, v in values.items() if k != axis})
            level = here[normal] if above and index == 0 else clear
            self._trace_line(self.offsets.on_machine(replaced(place, {normal: level})), rapid=True)
            self._go_to_level(retract, rapid=True)
            self._make_hole(code, retract, bottom, clear)

    def _make_hole(self, code: int, retract: float, bottom: float, clear: float) -> None:
        """Steps of LinuxCNC's cycles from the level of R to the bottom and out [m]."""
        # after G88, where an operator takes the tool out, it goes out at traverse
        if code in (730, 830):
            peck = self.sticky.get("Q", 0.0)
            if not peck > 0:
                raise ToolpathError(f"G{code // 10} needs a depth Q above 0")
            if (retract - bottom) / peck > MOST_PECKS:
                raise ToolpathError(f"G{code // 10}: more than {MOST_PECKS} pecks in a hole")
            depth = retract - peck
            while depth > bottom:
                self._go_to_level(depth, rapid=False)
                if code == 830:
                    self._go_to_level(retract, rapid=True)
                self._go_to_level(depth + PECK_CLEARANCE, rapid=True)
                depth -= peck
        self._go_to_level(bottom, rapid=False)
        if code in DWELLING and self.sticky.get("P"):
            self.tracer.dwell(self.sticky["P"], "P")
        if code == 850:
            self._go_to_level(retract, rapid=False)
        self._go_to_level(clear, rapid=code not in (740, 840, 890))

    def _go_to_level(self, level: float, rapid: bool) -> None:
        point = replaced(self.offsets.in_program(self.at), {PLANES[self.modes.plane][2]: level})
        self._trace_line(self.offsets.on_machine(point), rapid)

    def _feed(self) -> float:
        """Speed of a cutting move [m/s]."""
        feed = self.modes.feed
        if feed is None:
            raise ToolpathError(
                "a cutting move without a feed (F) before it; --feed-mm-per-min gives one"
            )
        if not feed > 0:
            raise ToolpathError("a cutting move at a feed of 0; --feed-mm-per-min gives another")
        return feed

    def _trace_line(self, end: Point, rapid: bool) -> None:
        self._trace(end, end, 0.0, math.nan if rapid else self._feed())
        self._joint()

    def _trace(self, end: Point, centre: Point, angle: float, feed: float) -> None:
        """Add a programmed move, or that of the tool beside it."""
        if self.compensation is None:
            self.tracer.add(end, centre, angle, feed, self.modes.plane)
            return
        self.compensation.add(end, centre, angle, feed)
        if self.compensation.leaving:
            self.compensation = None

    def _joint(self) -> None:
        """Stop at the end of a move where the mode in force asks for it."""
        if self.modes.path != 640:
            self.tracer.stop("G61" if self.modes.path == 610 else "G61.1")


def _in_space(plane: int, point: complex, level: float) -> Point:
    """Point in space from its place in a plane and its level along the plane's normal."""
    first, second, normal = PLANES[plane]
    coordinates = {first: point.real, second: point.imag, normal: level}
    return coordinates[0], coordinates[1], coordinates[2]

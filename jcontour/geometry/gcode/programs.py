"""Programs carried out from line to line: modal words, loops, branches and subprograms."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from jcontour.geometry.gcode import _words as codes
from jcontour.geometry.gcode._expressions import Locals, Parameters, evaluated, whole
from jcontour.geometry.gcode._flow import Structure, label_text
from jcontour.geometry.gcode._machine import Machine
from jcontour.geometry.gcode._words import NOTHING, SKIPPED, Block, OWord, read_block
from jcontour.geometry.gcode.machine_values import machine_values
from jcontour.geometry.gcode.modes import Tool
from jcontour.geometry.gcode.moves import Tracer
from jcontour.geometry.toolpath_rules import ToolpathError, lines_of, read_program, shown

MOST_REPEATED = 400_000  # lines carried out again; each takes twenty microseconds
MOST_STANDING = 100_000  # of them without a move
DEEPEST_CALL = 10  # of subprograms in subprograms, as LinuxCNC allows
MOST_ARGUMENTS = 30
FILE_NAME = re.compile(r"[a-z0-9_-]+")
MOST_REPEATS = 1_000_000

# lines of a subprogram's file by its name, None without one
ProgramFiles = Callable[[str], Sequence[str] | None]


def files_beside(program: Path) -> ProgramFiles:
    """Files beside a program: NAME.ngc holds the subprogram NAME.

    Their names are of small letters, digits, - and _, as LinuxCNC asks: none leads elsewhere.
    """

    def lines(name: str) -> list[str] | None:
        if not FILE_NAME.fullmatch(name):
            return None
        path = program.with_name(f"{name}.ngc")
        return lines_of(read_program(path)) if path.is_file() else None

    return lines


@dataclass
class Source:
    """Text of a program, read as it is carried out."""

    lines: Sequence[str]
    name: str = ""  # of the file of a subprogram; empty for the program itself
    reached: int = -1  # the farthest line that was carried out
    blocks: dict[int, Block] = field(default_factory=dict)  # of lines that may come again

    @cached_property
    def structure(self) -> Structure:
        """Where its O-words lead."""
        return Structure(self.lines)


@dataclass
class Frame:
    """A program or subprogram under way."""

    source: Source
    next: int = 0
    kept: Locals | None = None  # parameters of the caller
    begin: int = 0  # where M98 with L repeats it
    laps: int = 1  # of M98 still to be done, this one included
    by_m98: bool = False
    loops: dict[int, int] = field(default_factory=dict)  # rounds left of repeats, by first line
    branched: set[int] = field(default_factory=set)  # branches whose turn was skipped to


@dataclass
class Program:
    """A program under way on a machine."""

    machine: Machine  # what carries out its words
    files: ProgramFiles | None  # of subprograms
    parameters: Parameters  # of the program
    frames: list[Frame]  # the program, and the subprograms it is in
    repeated: int = 0  # lines that were carried out again
    moves_before: int = 0  # at the last line carried out again that came after a move
    repeated_before: int = 0
    marked: bool = False  # by a first %
    begun: bool = False  # whether a line that says something has come

    def run(self, most_lines: int | None = None) -> None:
        """Carry out lines up to the end of the program, or so many.

        Raises:
            ToolpathError: "line 12: ..." for whatever cannot be read or traced.
        """
        count = 0
        while not self.machine.ended and (most_lines is None or count < most_lines):
            frame = self.frames[-1]
            if frame.next >= len(frame.source.lines):
                if len(self.frames) > 1:
                    raise ToolpathError(f"{self._place(frame)}the file ends in a subprogram")
                return
            try:
                self._carry_out(frame)
            except ToolpathError as error:
                raise ToolpathError(f"{self._place(frame)}{error}") from None
            count += 1

    def _place(self, frame: Frame) -> str:
        file = f"{frame.source.name} " if frame.source.name else ""
        return f"{file}line {frame.next if frame.next else 1}: "

    def _carry_out(self, frame: Frame) -> None:
        index = frame.next
        frame.next += 1
        source = frame.source
        if source is self.frames[0].source:  # of another file, the call is named
            self.machine.tracer.line = index + 1
        block = source.blocks.get(index)
        if block is None:
            line = source.lines[index]
            if "%" in line and line.lstrip().startswith("%"):
                if self.begun or self.marked:  # the first one opens a program, the next one ends it
                    self.machine.ended = True
                self.marked = True
                block = NOTHING
            else:
                block = read_block(line)
        if index > source.reached:
            source.reached = index
        else:
            source.blocks[index] = block
            self.repeated += 1
            moves = len(self.machine.moves)
            if moves > self.moves_before:
                self.moves_before, self.repeated_before = moves, self.repeated
            standing = self.repeated - self.repeated_before
            if self.repeated > MOST_REPEATED or standing > MOST_STANDING:
                raise ToolpathError(
                    f"{self.repeated} lines carried out again, {standing} of them without a move: "
                    "a loop that does not end?"
                )
        if block is SKIPPED:
            self.machine.skipped.setdefault((source.name, index), self.machine.tracer.line)
        if block is NOTHING or block is SKIPPED:
            return
        self.begun = True
        if block.abort is not None:
            raise ToolpathError(f"the program aborts: {shown(block.abort, 80)}")
        if block.shows_message:
            self.machine.tracer.stop("(MSG)")
        if block.flow is not None:
            self._flow(frame, index, block.flow)
        else:
            self._execute(frame, block)

    def _execute(self, frame: Frame, block: Block) -> None:
        parameters = self.parameters
        words = [
            (letter, value if isinstance(value, int | float) else evaluated(value, parameters))
            for letter, value in block.words
        ]
        # once all values are known
        settings = [(key(parameters), evaluated(one, parameters)) for key, one in block.settings]
        for key, value in settings:
            parameters.set(key, value)
        if not words:
            return
        line = self.machine.execute(words)
        for code in line.m_codes:
            if code == codes.CALL:
                if "P" not in line.values:
                    raise ToolpathError("M98 needs P")
                label = str(whole(line.values["P"], "P of M98"))
                laps = whole(line.values.get("L", 1.0), "L of M98")
                if not 0 <= laps <= MOST_REPEATS:
                    raise ToolpathError(
                        f"L of M98 needs to be 0 to {MOST_REPEATS}, received {laps}"
                    )
                source, begin = self._subprogram(label)
                if laps:
                    self._enter(Frame(source, begin, begin=begin, laps=laps, by_m98=True))
            elif code == codes.RETURN:  # one lap of a program that would begin anew for ever
                if "P" in line.values:
                    raise ToolpathError(
                        "M99 with P goes on at another line, which is not simulated"
                    )
                if len(self.frames) == 1:
                    self.machine.ended = True
                elif frame.laps > 1:
                    frame.laps -= 1
                    frame.next = frame.begin
                else:
                    self.frames.pop()

    def _flow(self, frame: Frame, index: int, word: OWord) -> None:
        """Go where an O-word leads."""
        places, parameters = frame.source.structure, self.parameters
        if index in places.faults:
            raise ToolpathError(places.faults[index])
        match word.keyword:
            case "call":
                if len(word.values) > MOST_ARGUMENTS:
                    raise ToolpathError(f"more than {MOST_ARGUMENTS} arguments of a subprogram")
                label = word.label_in(parameters)
                arguments = [evaluated(value, parameters) for value in word.values]
                source, begin = self._subprogram(label)
                self._enter(Frame(source, begin, parameters.enter(arguments)))
            case "sub":
                frame.next = places.following[index] + 1
            case "endsub" | "return":
                if len(self.frames) == 1 or frame.by_m98:
                    raise ToolpathError(f"{word.keyword} outside a subprogram")
                if word.values:
                    parameters.common["_value"] = self._value(word)
                if frame.kept is not None:
                    parameters.leave(frame.kept)
                self.frames.pop()
            case "elseif" | "else" if index not in frame.branched:
                frame.next = places.ending[index] + 1  # from the end of the branch before
            case "if" | "elseif" | "else":
                frame.branched.discard(index)
                if word.keyword != "else" and not self._value(word):
                    frame.next = following = places.following[index]
                    if following != places.ending[index]:
                        frame.branched.add(following)
            case "break" | "continue":
                begin = places.beginning[index]
                frame.next = places.ending[begin]
                if word.keyword == "break":
                    frame.next += 1
                    frame.loops.pop(begin, None)
            case "while" if index in places.beginning:  # the end of a do
                if self._value(word):
                    frame.next = places.beginning[index] + 1
            case "while":
                if not self._value(word):
                    frame.next = places.ending[index] + 1
            case "repeat":
                if index not in frame.loops:
                    rounds = self._value(word)
                    frame.loops[index] = whole(rounds, "the number of rounds") if rounds > 0 else 0
                frame.loops[index] -= 1
                if frame.loops[index] < 0:
                    del frame.loops[index]
                    frame.next = places.ending[index] + 1
            case "endwhile" | "endrepeat":
                frame.next = places.beginning[index]

    def _value(self, word: OWord) -> float:
        return evaluated(word.values[0], self.parameters)

    def _subprogram(self, label: str) -> tuple[Source, int]:
        """Source and first line inside a subprogram: here, in the program itself, or in a file."""
        for frame in (self.frames[-1], self.frames[0]):
            if label in frame.source.structure.subprograms:
                return frame.source, frame.source.structure.subprograms[label] + 1
        name = label.strip("<>")
        called = (frame.source for frame in self.frames if frame.source.name == f"{name}.ngc")
        source = next(called, None)
        if source is None:
            lines = None if self.files is None else self.files(name)
            if lines is None:
                raise ToolpathError(f"there is no subprogram {label_text(label)}")
            source = Source(lines, name=f"{name}.ngc")
        if label not in source.structure.subprograms:
            raise ToolpathError(f"{name}.ngc: there is no subprogram {label_text(label)} in it")
        return source, source.structure.subprograms[label] + 1

    def _enter(self, frame: Frame) -> None:
        if len(self.frames) > DEEPEST_CALL:
            raise ToolpathError(f"subprograms call each other more than {DEEPEST_CALL} deep")
        self.frames.append(frame)


def interpreted(
    lines: Sequence[str],
    axes: int,
    feed: float | None,
    files: ProgramFiles | None = None,
    most_lines: int | None = None,
    tools: dict[int, Tool] | None = None,
) -> Machine:
    """Machine that has carried out the lines of a program, up to its end (M2, M30, %).

    >>> program = interpreted(["G1 X1 F600", "X2", "M30", "not read"], axes=2, feed=None)
    >>> len(program.moves)
    2

    Args:
        lines: of the program.
        axes: 3, or 2 for the projection to X and Y.
        feed: in force at the beginning [m/s]; None where the program has to give one.
        files: lines of the files that subprograms are in.
        most_lines: so many are carried out at most; None for all.
        tools: of a tool table, by number; None without one.

    Raises:
        ToolpathError: "line 12: ..." for whatever cannot be read or traced.
    """
    machine = Machine(Tracer(axes), feed, tools)
    parameters = Parameters()
    program = Program(machine, files, parameters, [Frame(Source(lines))])
    parameters.machine = lambda key: machine_values(machine, key, len(program.frames) - 1)
    program.run(most_lines)
    return machine

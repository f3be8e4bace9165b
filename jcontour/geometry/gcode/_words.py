"""Lines of a program as a control reads them: words, settings of parameters, or an O-word.

White space outside comments means nothing, nor does the case of letters. A line that begins with /
is skipped, as with the block-delete switch on. Comments are (in brackets), up to (three (deep)), or
; to the end. G codes are ten times their number, so that G59.1 is whole. One of a group is in force
at a time.
"""

import math
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

from jcontour.geometry.gcode._expressions import (
    FUNCTIONS,
    NAME,
    Cursor,
    Expression,
    Parameters,
    evaluated,
    read_bracket,
    read_key,
    read_value,
    whole,
)
from jcontour.geometry.toolpath_rules import NUMBER, ToolpathError, shown

CYCLES = frozenset({730, 740, 810, 820, 830, 840, 850, 860, 880, 890})  # canned, expanded to moves
NO_MOTION = 800
GROUPS = {
    "motion": frozenset({0, 10, 20, 30, NO_MOTION}) | CYCLES,
    "plane": frozenset({170, 180, 190}),
    "units": frozenset({200, 210, 700, 710}),  # G70, G71: of other controls
    "distance": frozenset({900, 910}),
    "centres": frozenset({901, 911}),
    "feed": frozenset({940}),
    "path": frozenset({610, 611, 640}),
    "compensation": frozenset({400, 410, 411, 420, 421}),
    "tool length": frozenset({430, 431, 490}),
    "return": frozenset({980, 990}),
    "system": frozenset({540, 550, 560, 570, 580, 590, 591, 592, 593}),
    "once": frozenset({40, 100, 280, 281, 300, 301, 520, 530, 920, 921, 922, 923}),
}
GROUP_OF = {code: group for group, codes in GROUPS.items() for code in codes}
# of the once group; they take the axis words away from the motion in force
TAKING_AXES = frozenset({100, 280, 300, 520, 920})
# of it, too; they shift the program's origin, for which LinuxCNC waits for the motion
SHIFTING = frozenset({520, 920, 921, 922, 923})
# nothing of what they ask for moves this machine: spindle speed modes, and cancelling what could
# not be switched on (scaling, mirrors, rotation, polar coordinates, plane tilt, radii of lathes)
IGNORED = frozenset({131, 150, 401, 500, 501, 690, 960, 970})
NO_PRINTERS = "programs of 3D printers are not read"
HEATERS = frozenset({104, 109, 140, 190})  # M codes of printers
REFUSED_M = frozenset({70, 71, 72, 73, 96, 97})  # the modal state kept; jumps of Haas
LETTERS = {  # that belong to a code, besides those of motion
    20: "P",
    30: "P",
    40: "PXUS",
    100: "LPR",
    430: "H",
    640: "PQ",
    960: "D$",
    970: "$",
    **dict.fromkeys(CYCLES, "LPQR$"),
}
END = frozenset({2, 30})  # M codes that end the program
CALL, RETURN = 98, 99  # M codes of subprograms
FLOW = frozenset({CALL, RETURN})
FANS = frozenset({106, 107})  # of Marlin, which lasers burn by: they stop no motion
# M codes for which motion stops, as LinuxCNC's task controller waits for it before it carries them
# out (emctaskmain.cc): spindle, tool, coolant, outputs set at once, adaptive feed, and the user's
# own M100 to M199, before the move of their line; pauses after it. Outputs in time with the motion
# (M62, M63, M67) do not stop it; neither does S here, of which lasers have one a line.
STOPPING = frozenset({3, 4, 5, 6, 7, 8, 9, 19, 52, 61, 64, 65, 66, 68, *range(100, 200)}) - FANS
PAUSES = frozenset({0, 1, 60})
MOST_M = 9999
LARGEST = 1e9  # of any number in a program
KNOWN = frozenset("DEFHIJKLNPQRSTXYZ$")
OTHER_AXES = frozenset("ABCUVW")
NEED_A_CODE = frozenset("LPQ$")
NOT_NEGATIVE = frozenset("NST")
INNERMOST = r"\([^()]*\)"
NESTED = rf"\((?:[^()]|\((?:[^()]|{INNERMOST})*\))*\)"
COMMENT = re.compile(rf"{NESTED}|\([^)]*\)|(\().*|;.*")  # a ( without its ) is kept
ABORT = re.compile(r"[(;]\s*abort\s*,([^)]*)", re.IGNORECASE)
MESSAGE = re.compile(r"[(;]\s*msg\s*,", re.IGNORECASE)
PLAIN = re.compile(rf"(?:[A-Za-z]{NUMBER})+")
WORD = re.compile(rf"([A-Za-z])({NUMBER})")
LETTER = re.compile(r"[A-Za-z$]")
LINE_NUMBER = re.compile(r"[Nn][0-9.]+")
DIGITS = re.compile(r"[0-9]+")
VALUE = re.compile(rf"[+-]*(?:[\[#.0-9]|(?:{'|'.join(FUNCTIONS)}|ATAN|EXISTS)\[)", re.IGNORECASE)
EXPONENT = re.compile(  # other languages write numbers so; right behind G it is the word E
    r"(?<![Gg])(?<![Gg][0-9])[0-9.][eE][+-]?[0-9]+(?![0-9.])"
)
M66 = re.compile(r"[Mm]0*66(?![0-9.])")  # its E says which input it reads
KEYWORD = re.compile(  # the longest first: "do" begins no other, but "else" does
    "continue|endrepeat|endwhile|elseif|endsub|return|repeat|endif|break|while|call|else|sub|do|if",
    re.IGNORECASE,
)
NO_EXPONENTS = ": controls know no exponents; the word E needs a space before it here"
BRACKETS = {  # least and most values behind an O-word; none behind all others
    **dict.fromkeys(("if", "elseif", "while", "repeat"), (1, 1)),
    **dict.fromkeys(("return", "endsub"), (0, 1)),
    "call": (0, math.inf),
}
Key = Callable[[Parameters], int | str]


class LineWords(NamedTuple):
    """Words of one line."""

    codes: dict[str, int]  # G code by its group, in tenths
    without_motion: list[int]  # G codes that do not move this machine, in tenths
    m_codes: list[int]  # M codes in order
    values: dict[str, float]  # numbers of the other letters, line numbers left out


def sorted_words(words: Sequence[tuple[str, float]], motion: int | None) -> LineWords:
    """Sort the words of a line.

    Args:
        words: letters and numbers.
        motion: code of the motion in force, in tenths.
    """
    line = LineWords({}, [], [], {})
    for letter, value in words:
        if not abs(value) <= LARGEST:
            raise ToolpathError(f"the number in {shown(f'{letter}{value:.6g}')} is too large")
        if letter == "G":
            _add_g_code(line, value)
        elif letter == "M":
            code = whole(value, "an M code")
            if not 0 <= code <= MOST_M or code in REFUSED_M | HEATERS:
                reason = f" ({NO_PRINTERS})" if code in HEATERS else ""
                raise ToolpathError(f"'M{code}' is not supported{reason}")
            line.m_codes.append(code)
        elif letter in OTHER_AXES and value:
            raise ToolpathError(
                f"'{letter}{value:g}' moves an axis that is not simulated: only X, Y and Z are"
            )
        elif letter not in KNOWN | OTHER_AXES:
            raise ToolpathError(f"unknown word '{letter}{value:g}'")
        elif letter in NOT_NEGATIVE and (value < 0 or (letter == "T" and value % 1)):
            needed = "a whole number" if letter == "T" else "a number"
            raise ToolpathError(
                f"'{letter}{value:g}': {letter} needs {needed} that is not negative"
            )
        elif letter in line.values and letter not in OTHER_AXES:
            raise ToolpathError(f"{letter} is given twice")
        else:
            line.values[letter] = value
    line.values.pop("N", None)
    if not (NEED_A_CODE.isdisjoint(line.values) or line.m_codes):  # machines' M codes take any
        in_force = () if "motion" in line.codes or motion is None else (motion,)
        letters = (
            LETTERS.get(c, "") for c in (*line.codes.values(), *line.without_motion, *in_force)
        )
        for letter in sorted((NEED_A_CODE & line.values.keys()) - set("".join(letters))):
            raise ToolpathError(
                f"unknown word '{letter}{line.values[letter]:g}': no code here needs {letter}"
            )
    return line


def _add_g_code(line: LineWords, value: float) -> None:
    """Add a code to its group; G80 beside a motion code only ends what was in force before."""
    code = whole(10 * value, "ten times a G code")
    if code in IGNORED:
        line.without_motion.append(code)
        return
    group = GROUP_OF.get(code)
    if group is None:
        raise ToolpathError(f"'G{code / 10:g}' is not supported")
    other = line.codes.get(group)
    if other is None or other == code or (group == "motion" and other == NO_MOTION):
        line.codes[group] = code
    elif group == "once" and 530 in (code, other):
        raise ToolpathError(f"G53 and G{(code + other - 530) / 10:g} in one line")
    elif not (group == "motion" and code == NO_MOTION):
        raise ToolpathError(
            f"'G{code / 10:g}' and another G code of its kind ({group}) in one line"
        )


class OWord(NamedTuple):
    """Flow of the program: `o100 while [#1 LT 5]`."""

    keyword: str  # sub, call, if, ...; empty where the number of a program stands alone, O1000
    label: str | Expression  # number or name, or what computes the number
    # in brackets behind: the condition, the count, the arguments
    values: tuple[Expression, ...] = ()

    def label_in(self, parameters: Parameters) -> str:
        """Its number or name."""
        if isinstance(self.label, str):
            return self.label
        return str(whole(evaluated(self.label, parameters), "the number of an O-word"))


class Block(NamedTuple):
    """Content of one line."""

    # letters in upper case and their numbers, or what computes them
    words: tuple[tuple[str, float | Expression], ...] = ()
    # parameters and values, in force once all words have their numbers
    settings: tuple[tuple[Key, Expression], ...] = ()
    flow: OWord | None = None  # O-word, which stands alone
    abort: str | None = None  # message of (ABORT, ...), None without one
    shows_message: bool = False  # whether it has (MSG, ...), before which the motion stops


NOTHING = Block()
SKIPPED = Block()  # it says something, but begins with /


def read_block(line: str) -> Block:
    """Read a line.

    >>> read_block("n10 g1 x2.5 (to the right)").words
    (('N', 10.0), ('G', 1.0), ('X', 2.5))

    Args:
        line: of a program.
    """
    stripped, asked = line, NOTHING
    if "(" in line or ";" in line:
        stripped = COMMENT.sub(r"\1 ", line)
        last = "".join([comment[0] for comment in COMMENT.finditer(line)][-1:])
        abort, shows_message = ABORT.match(last), bool(MESSAGE.match(last))
        if abort or shows_message:
            asked = Block(abort=abort[1].strip() if abort else None, shows_message=shows_message)
    text = "".join(stripped.split())
    if text.startswith("/"):
        return NOTHING if text == "/" else SKIPPED
    if ")" in stripped and "(" in line:
        raise ToolpathError(f"a ) too many: {shown(line.strip())}")
    if "(" in stripped:
        raise ToolpathError(f"a comment without its ): {shown(line.strip())}")
    if not text:
        return asked
    exponents = bool(EXPONENT.search(stripped)) and not M66.search(text)
    if PLAIN.fullmatch(text) and not ("o" in text or "O" in text or exponents):
        words = [(letter.upper(), float(number)) for letter, number in WORD.findall(text)]
        return asked._replace(words=tuple(words))
    try:
        block = _read(Cursor(text), stripped, exponents)
    except RecursionError:
        raise ToolpathError("an expression is nested too deeply") from None
    return block._replace(abort=asked.abort, shows_message=asked.shows_message)


def _read(cursor: Cursor, line: str, exponents: bool) -> Block:
    cursor.take(LINE_NUMBER)
    if cursor.starts("o") or cursor.starts("O"):
        cursor.at += 1
        digits = cursor.take(DIGITS)
        name = None if digits else cursor.take(NAME)
        if digits:
            label = str(int(digits[0][:20]))
        elif name:
            label = f"<{name[1].lower()}>"
        elif cursor.starts("[") or cursor.starts("#"):
            label = read_value(cursor)
        else:
            raise ToolpathError(f"an O-word needs a number or a name before {shown(cursor.rest)}")
        match = cursor.take(KEYWORD)
        keyword = match[0].lower() if match else ""
        values: list[Expression] = []
        while cursor.starts("[") and keyword:
            values.append(read_bracket(cursor))
        if not cursor.ended:
            raise ToolpathError(f"cannot read {shown(cursor.rest)} behind an O-word")
        least, most = BRACKETS.get(keyword, (0, 0))
        if not least <= len(values) <= most:
            raise ToolpathError(f"O-word {keyword!r} with {len(values)} values in brackets")
        return Block(flow=OWord(keyword, label, tuple(values)))
    words: list[tuple[str, float | Expression]] = []
    settings: list[tuple[Key, Expression]] = []
    while not cursor.ended:
        if cursor.starts("#"):
            key = read_key(cursor)
            cursor.expect("=")
            settings.append((key, read_value(cursor)))
            continue
        before, letter = cursor.at, cursor.take(LETTER)
        exponent = exponents and letter is not None and letter[0] in "eE"
        if letter is None or exponent or not VALUE.match(cursor.text, cursor.at):
            places = [place for place, character in enumerate(line) if not character.isspace()]
            written = shown(line[places[before] :])  # with its white space
            raise ToolpathError(f"cannot read {written}{NO_EXPONENTS if exponent else ''}")
        number = WORD.match(cursor.text, before)
        if number is None:
            words.append((letter[0].upper(), read_value(cursor)))
        else:
            words.append((letter[0].upper(), float(number[2])))
            cursor.at = number.end()
    return Block(tuple(words), tuple(settings))

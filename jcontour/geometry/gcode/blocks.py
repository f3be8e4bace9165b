"""A line of a program as a control reads it: words, settings of parameters, or an O-word.

White space outside comments means nothing, nor does the case of letters. A line that begins with /
is skipped, as with the block-delete switch on. Comments are (in brackets), up to (three (deep)), or
; to the end.
"""

import re
from collections.abc import Callable
from typing import NamedTuple

from jcontour.geometry.gcode.expressions import (
    FUNCTIONS,
    NAME,
    Cursor,
    Expression,
    evaluated,
    read_bracket,
    read_key,
    read_value,
    whole,
)
from jcontour.geometry.gcode.parameters import Parameters
from jcontour.geometry.toolpath_rules import NUMBER, ToolpathError, shown

INNERMOST = r"\([^()]*\)"
NESTED = rf"\((?:[^()]|\((?:[^()]|{INNERMOST})*\))*\)"
COMMENT = re.compile(rf"{NESTED}|\([^)]*\)|(\().*|;.*")  # a ( without its ) is kept
ABORT = re.compile(r"[(;]\s*abort\s*,([^)]*)", re.IGNORECASE)
MESSAGE = re.compile(r"[(;]\s*msg\s*,", re.IGNORECASE)
PLAIN = re.compile(rf"(?:[A-Za-z]{NUMBER})+")
WORD = re.compile(rf"([A-Za-z])({NUMBER})")
LETTER = re.compile(r"[A-Za-z@^$]")
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
MOST_TOLD = 20  # letters of a line for grbl itself
NO_EXPONENTS = ": controls know no exponents; the word E needs a space before it here"
CONDITIONAL = frozenset({"if", "elseif", "while", "repeat"})  # these need a value
RETURNING = frozenset({"return", "endsub"})  # these may have one

Key = Callable[[Parameters], int | str]


class OWord(NamedTuple):
    """Flow of the program: `o100 while [#1 LT 5]`.

    Attributes:
        keyword: sub, call, if, ...; empty where the number of a program stands alone, O1000.
        label: number or name.
        values: in brackets behind: the condition, the count, the arguments.
    """

    keyword: str
    label: Callable[[Parameters], str]
    values: tuple[Expression, ...] = ()


class Block(NamedTuple):
    """Content of one line.

    Attributes:
        words: letters in upper case and their numbers, or what computes them.
        settings: parameters and values, in force once all words have their numbers.
        flow: O-word, which stands alone.
        abort: message of (ABORT, ...), None without one.
        shows_message: whether it has (MSG, ...), before which the motion stops.
    """

    words: tuple[tuple[str, float | Expression], ...] = ()
    settings: tuple[tuple[Key, Expression], ...] = ()
    flow: OWord | None = None
    abort: str | None = None
    shows_message: bool = False


NOTHING = Block()
SKIPPED = Block()  # it says something, but begins with /


def read_block(line: str) -> Block:
    """Read a line.

    >>> read_block("n10 g1 x2.5 (to the right)").words
    (('N', 10.0), ('G', 1.0), ('X', 2.5))

    Args:
        line: of a program.

    Raises:
        ToolpathError: it is no line of a program.
    """
    if "(" in line or ";" in line:
        stripped = COMMENT.sub(r"\1 ", line)
        text = "".join(stripped.split())
        if text.startswith("/"):
            return NOTHING if text == "/" else SKIPPED
        if ")" in stripped and "(" in line:
            raise ToolpathError(f"a ) too many: {shown(line.strip())}")
        if "(" in stripped:
            raise ToolpathError(f"a comment without its ): {shown(line.strip())}")
        said = _said(line)
    else:
        stripped, said = line, NOTHING
        text = "".join(stripped.split())
    if text.startswith("/"):
        return NOTHING if text == "/" else SKIPPED
    if not text:
        return said
    exponents = bool(EXPONENT.search(stripped)) and not M66.search(text)
    if PLAIN.fullmatch(text) and not ("o" in text or "O" in text or exponents):
        words = [(letter.upper(), float(number)) for letter, number in WORD.findall(text)]
        return said._replace(words=tuple(words))
    try:
        found = _read(Cursor(text), stripped, exponents)
    except RecursionError:
        raise ToolpathError("an expression is nested too deeply") from None
    return found._replace(abort=said.abort, shows_message=said.shows_message)


def _said(line: str) -> Block:
    """What the last comment of a line asks for."""
    comments = [found[0] for found in COMMENT.finditer(line)]
    if not comments:
        return NOTHING
    match = ABORT.match(comments[-1])
    shows_message = bool(MESSAGE.match(comments[-1]))
    if match is None and not shows_message:
        return NOTHING
    return Block(abort=match[1].strip() if match else None, shows_message=shows_message)


def _read(cursor: Cursor, line: str, exponents: bool) -> Block:
    cursor.take(LINE_NUMBER)
    if cursor.starts("o") or cursor.starts("O"):
        return Block(flow=_read_o_word(cursor))
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


def _read_o_word(cursor: Cursor) -> OWord:
    cursor.at += 1
    label = _read_label(cursor)
    match = cursor.take(KEYWORD)
    keyword = match[0].lower() if match else ""
    values: list[Expression] = []
    while cursor.starts("[") and keyword:
        values.append(read_bracket(cursor))
    if not cursor.ended:
        raise ToolpathError(f"cannot read {shown(cursor.rest)} behind an O-word")
    if keyword in CONDITIONAL:
        fits = len(values) == 1
    elif keyword in RETURNING:
        fits = len(values) <= 1
    else:
        fits = keyword == "call" or not values
    if not fits:
        raise ToolpathError(f"O-word {keyword!r} with {len(values)} values in brackets")
    return OWord(keyword, label, tuple(values))


def _read_label(cursor: Cursor) -> Callable[[Parameters], str]:
    digits = cursor.take(DIGITS)
    if digits:
        number = str(int(digits[0][:20]))
        return lambda parameters: number
    name = cursor.take(NAME)
    if name:
        key = f"<{name[1].lower()}>"
        return lambda parameters: key
    if not (cursor.starts("[") or cursor.starts("#")):
        raise ToolpathError(f"an O-word needs a number or a name before {shown(cursor.rest)}")
    value = read_value(cursor)
    return lambda parameters: str(whole(evaluated(value, parameters), "the number of an O-word"))


def sender_word(line: str) -> str | None:
    """What is told of a line that is not G-code; None for G-code.

    >>> sender_word("$32=1"), sender_word("?  ; the status"), sender_word("G1 X1")
    ('$32', '?', None)

    Raises:
        ToolpathError: a jog, which would move the machine.
    """
    begin = line.lstrip()[:1]
    if begin == "$":
        word = "".join(line.split()).upper()
        if word.startswith("$J"):
            raise ToolpathError(f"{shown(line)} is a jog of grbl, which is not simulated")
        return word.split("=")[0][:MOST_TOLD]
    if begin and begin in "?~" and COMMENT.sub(r"\1", line).strip() == begin:
        return begin
    return None

"""Words of one line, sorted: what it switches, what M codes it has, what its letters say."""

from collections.abc import Sequence
from typing import NamedTuple

from jcontour.geometry.gcode.language.codes import (
    GROUP_OF,
    LETTERS,
    LOOK_AHEAD,
    g_code,
    m_code,
)
from jcontour.geometry.toolpath_rules import ToolpathError, shown

LARGEST = 1e9  # of any number in a program
KNOWN = frozenset("DEFHIJKLNPQRSTXYZ@^$")
OTHER_AXES = frozenset("ABCUVW")
NEED_A_CODE = frozenset("LPQ$")
NOT_NEGATIVE = frozenset("NST")


class LineWords(NamedTuple):
    """Words of one line.

    Attributes:
        codes: G code by its group, in tenths.
        without_motion: G codes that do not move this machine, in tenths.
        m_codes: M codes in order.
        values: numbers of the other letters, line numbers left out.
    """

    codes: dict[str, int]
    without_motion: list[int]
    m_codes: list[int]
    values: dict[str, float]


def sorted_words(words: Sequence[tuple[str, float]], motion: int | None) -> LineWords:
    """Sort the words of a line.

    Args:
        words: letters and numbers.
        motion: code of the motion in force, in tenths.

    Raises:
        ToolpathError: an unknown word, a letter twice, two codes of a group, a number that is too
            large, an axis that is not simulated.
    """
    codes: dict[str, int] = {}
    without_motion: list[int] = []
    m_codes: list[int] = []
    values: dict[str, float] = {}
    for letter, value in words:
        if not abs(value) <= LARGEST:
            raise ToolpathError(f"the number in {shown(f'{letter}{value:.6g}')} is too large")
        if letter == "G":
            code = _code(value, words)
            if code in GROUP_OF:
                _add_code(codes, code)
            else:
                without_motion.append(code)
        elif letter == "M":
            m_codes.append(m_code(value))
        elif letter in OTHER_AXES:
            if value:
                raise ToolpathError(
                    f"'{letter}{value:g}' moves an axis that is not simulated: only X, Y and Z are"
                )
            values[letter] = value
        elif letter not in KNOWN:
            raise ToolpathError(f"unknown word '{letter}{value:g}'")
        else:
            _check_sign(letter, value)
            if letter in values:
                raise ToolpathError(f"{letter} is given twice")
            values[letter] = value
    values.pop("N", None)
    found = LineWords(codes, without_motion, m_codes, values)
    if not NEED_A_CODE.isdisjoint(values):
        _check_letters(found, motion)
    return found


def _code(value: float, words: Sequence[tuple[str, float]]) -> int:
    """Ten times a G code; G5 and G5.1 without axes are Fanuc's look-ahead, with axes splines."""
    if value in LOOK_AHEAD and not any(letter in "XYZIJ" for letter, _ in words):
        return round(10 * value)
    return g_code(value)


def _check_sign(letter: str, value: float) -> None:
    if letter in NOT_NEGATIVE and (value < 0 or (letter == "T" and value % 1)):
        needed = "a whole number" if letter == "T" else "a number"
        raise ToolpathError(f"'{letter}{value:g}': {letter} needs {needed} that is not negative")


def _add_code(codes: dict[str, int], code: int) -> None:
    """Add a code to its group; G80 beside a motion code only ends what was in force before."""
    group = GROUP_OF[code]
    other = codes.get(group)
    if other is None or other == code or (group == "motion" and other == 800):
        codes[group] = code
    elif group == "once" and 530 in (code, other):
        raise ToolpathError(f"G53 and G{(code + other - 530) / 10:g} in one line")
    elif not (group == "motion" and code == 800):
        raise ToolpathError(
            f"'G{code / 10:g}' and another G code of its kind ({group}) in one line"
        )


def _check_letters(found: LineWords, motion: int | None) -> None:
    """L, P, Q and $ (a spindle) need a code; M codes of a machine may have any."""
    if found.m_codes:
        return
    allowed = "".join(
        LETTERS.get(code, "") for code in (*found.codes.values(), *found.without_motion)
    )
    if "motion" not in found.codes and motion is not None:
        allowed += LETTERS.get(motion, "")
    for letter in sorted(NEED_A_CODE & found.values.keys()):
        if letter not in allowed:
            raise ToolpathError(
                f"unknown word '{letter}{found.values[letter]:g}': no code here needs {letter}"
            )

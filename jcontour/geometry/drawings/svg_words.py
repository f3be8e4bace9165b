"""Lengths, numbers and transforms in the attributes of SVG."""

import cmath
import math
import re

from jcontour.geometry.drawings.affine import Affine
from jcontour.geometry.drawings.svg_tree import Element
from jcontour.geometry.toolpath_rules import ToolpathError, shown

NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
NUMBERS = re.compile(rf"[\s,]*({NUMBER})")
LENGTH = re.compile(rf"({NUMBER})\s*([a-zA-Z%]*)")
TRANSFORM = re.compile(r"[\s,]*([a-zA-Z]+)\s*\(([^()]*)\)[\s,]*")
PX = 25.4e-3 / 96  # [m] of CSS
IN_PX = {
    "": 1.0,
    "px": 1.0,
    "pt": 96 / 72,
    "pc": 16.0,
    "in": 96.0,
    "mm": 96 / 25.4,
    "cm": 960 / 25.4,
    "Q": 24 / 25.4,
}


def length(element: Element, name: str, default: float = 0.0, whole: float = math.nan) -> float:
    """A length in user units; a percentage is of `whole`.

    Raises:
        ToolpathError: it is none, or too large.
    """
    text = element.text(name)
    if not text or text == "auto":
        return default
    found = LENGTH.fullmatch(text)
    if found and found[2] in IN_PX:
        return number(found[1], element.line, IN_PX[found[2]])
    if found and found[2] == "%" and math.isfinite(whole):
        return number(found[1], element.line, 0.01 * whole)
    raise ToolpathError(
        f"line {element.line}: {name} needs a length in px, mm, cm, in, pt or pc, "
        f"received {shown(text)}"
    )


def numbers(element: Element, name: str) -> list[float]:
    """Numbers of an attribute, with spaces or commas between them.

    Raises:
        ToolpathError: something else is among them, or one is too large.
    """
    return _numbers(element.attributes.get(name, ""), element, name)


def number(text: str, line: int, unit: float = 1.0) -> float:
    """A number on a line of the file, times a unit.

    Raises:
        ToolpathError: it is too large.
    """
    value = float(text) * unit
    if not math.isfinite(value):
        raise ToolpathError(f"line {line}: the number {shown(text)} is too large")
    return value


def _numbers(text: str, element: Element, name: str) -> list[float]:
    found, at = [], 0
    while match := NUMBERS.match(text, at):
        found.append(number(match[1], element.line))
        at = match.end()
    if text[at:].strip(" \t\r\n,"):
        raise ToolpathError(
            f"line {element.line}: {name} needs numbers, received {shown(text[at:])}"
        )
    return found


def transform(element: Element, name: str = "transform") -> Affine:
    """The map of a transform attribute: the last of its list acts first.

    Raises:
        ToolpathError: an unknown one, or with other numbers than it takes.
    """
    text, at, whole = element.text(name), 0, Affine()
    while at < len(text):
        match = TRANSFORM.match(text, at)
        one = match and _one(match[1], _numbers(match[2], element, name))
        if not match or one is None or not one.finite():
            raise ToolpathError(
                f"line {element.line}: {name} cannot be read from {shown(text[at:])}"
            )
        whole, at = whole.after(one), match.end()
    return whole


def _one(kind: str, given: list[float]) -> Affine | None:
    count = len(given)
    if kind == "matrix" and count == 6:
        a, b, c, d, e, f = given
        return Affine.matrix(complex(a, b), complex(c, d), complex(e, f))
    if kind == "translate" and count in (1, 2):
        return Affine(shift=complex(*given))
    if kind == "scale" and count in (1, 2):
        return Affine.matrix(given[0], 1j * given[-1], 0.0)
    if kind == "rotate" and count in (1, 3):
        centre = complex(*given[1:]) if count == 3 else 0.0
        turn = cmath.rect(1.0, math.radians(given[0]))
        return Affine(turn, 0.0, centre - turn * centre)
    if kind in ("skewX", "skewY") and count == 1:
        slope = math.tan(math.radians(given[0]))
        return (
            Affine.matrix(1.0, slope + 1j, 0)
            if kind == "skewX"
            else (Affine.matrix(1 + 1j * slope, 1j, 0.0))
        )
    return None

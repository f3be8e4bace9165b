"""Numbers, tables, comments and statements as the text of a program, in C and other languages.

The step of a law has one statement a line: loops that count, conditions, assignments, `return`. Its
functions are `absolute`, `least` and `most`.
"""

import re
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

Precision = Literal["double", "single"]
COLUMNS = 100  # of a line of code


def literal(value: float, precision: Precision = "double") -> str:
    """A number that reads back to the last bit; always with a point, as structured text asks.

    >>> literal(1e-5), literal(2.0), literal(0.1, "single")
    ('1.0e-05', '2.0', '0.1f')

    Raises:
        ValueError: it is not finite.
    """
    if not np.isfinite(value):
        raise ValueError(f"a table for a drive needs finite numbers, received {value}")
    text = str(np.float32(value)) if precision == "single" else repr(float(value))
    mantissa, e, exponent = text.partition("e")
    point = "" if "." in mantissa else ".0"
    return f"{mantissa}{point}{e}{exponent}{'f' if precision == 'single' else ''}"


def table(values: Float[np.ndarray, "..."], precision: Precision = "double") -> str:
    """All numbers of an array with commas, a line for each row of its last axis."""
    rows = np.reshape(values, (-1, np.shape(values)[-1]))
    return ",\n".join(_row([literal(value, precision) for value in row]) for row in rows)


def _row(words: Sequence[str]) -> str:
    lines, line = [], "   "
    for k, word in enumerate(words):
        word = word if k == len(words) - 1 else f"{word},"
        if len(line) + len(word) + 1 > COLUMNS:
            lines.append(line)
            line = "   "
        line += f" {word}"
    return "\n".join([*lines, line])


def heading(name: str, unit: str, per: str | None = None) -> str:
    """Name of a CSV column that ends in its unit.

    >>> heading("f1", "N/kg"), heading("F1", "control unit", per="state 1")
    ('f1_N_per_kg', 'F1_control_unit_per_state_1')
    """
    text = unit if per is None else f"{unit}/{per}"
    return f"{name}_" + re.sub(r"[^\w%]+", "_", text.replace("/", "_per_"))


def plain(line: str) -> str:
    """One line of ASCII that neither ends a comment of C or structured text nor begins one."""
    words = " ".join(line.split()).encode("ascii", "replace").decode()
    for mark in ("*/", "/*", "*)", "(*"):
        words = words.replace(mark, " ".join(mark))
    return words.rstrip("\\").replace("??/", "? ? /")


LOOP = re.compile(r"for \((\w) = (.+); \w (<|>=) (.+); \w(\+\+|--)\) {")


def in_c(text: str, precision: Precision) -> str:
    """The statements as they are, their numbers in the precision of the code."""
    text = text.replace("return;", "return (int)law->status;")
    return re.sub(r"\b(\d+\.\d+)\b", r"\1f", text) if precision == "single" else text


def in_python(text: str) -> str:
    """The same for Python."""
    lines, depth = [], 0
    for line in _lines(text):
        if line.startswith("/*"):
            lines.append("    " * depth + "# " + line[3:-3])
            continue
        if line.startswith("}"):
            depth -= 1
        statement = _python(line)
        if statement:
            lines.append("    " * depth + statement)
        if line.endswith("{"):
            depth += 1
    return "\n".join(lines)


def in_structured_text(text: str) -> str:
    """The same for IEC 61131-3: arrays begin at 0."""
    lines, ends = [], []
    for line in _lines(text):
        if line.startswith("/*"):
            lines.append("    " * len(ends) + f"(* {line[3:-3]} *)")
            continue
        if line == "}":
            end = ends.pop()
            lines.append("    " * len(ends) + end)
            continue
        if line.startswith("}"):
            ends.pop()
        lines.append("    " * len(ends) + _structured(line))
        if line.endswith("{"):
            ends.append("END_FOR;" if line.startswith("for") else "END_IF;")
    return "\n".join(lines)


def _lines(text: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.strip()]


def _python(line: str) -> str:
    if loop := LOOP.fullmatch(line):
        name, first, _, last, way = loop.groups()
        if way == "++":
            return f"for {name} in range({first}, {last}):"
        return f"for {name} in range({first}, {last} - 1, -1):"
    line = line.replace("law->", "law.").replace("&&", "and").replace("||", "or")
    line = re.sub(r"!(?!=)", "not ", line)
    if line == "}":
        return ""
    if condition := re.fullmatch(r"(} else )?if \((.+)\) {", line):
        return f"{'elif' if condition[1] else 'if'} {condition[2]}:"
    if line == "} else {":
        return "else:"
    return line.removesuffix(";")


def _structured(line: str) -> str:
    line = line.replace("law->", "")
    if loop := LOOP.fullmatch(line):
        name, first, _, last, way = loop.groups()
        if way == "++":
            return f"FOR {name} := {first} TO {last} - 1 DO"
        return f"FOR {name} := {first} TO {last} BY -1 DO"
    if condition := re.fullmatch(r"(} else )?if \((.+)\) {", line):
        words = condition[2].replace("&&", "AND").replace("||", "OR").replace("!=", "<>")
        words = _called(re.sub(r"!(?!=)", "NOT ", words).replace("==", "="))
        # AND binds as in C, but some compilers want comparisons in parentheses
        joint = next((name for name in (" AND ", " OR ") if name in words), None)
        if joint:
            words = joint.join(f"({one})" for one in words.split(joint))
        return f"{'ELSIF' if condition[1] else 'IF'} {words} THEN"
    if line == "} else {":
        return "ELSE"
    if line == "return;":
        return "RETURN;"
    assigned = re.fullmatch(r"([^=]+?) ([+-]?)= (.+);", line)
    if assigned is None:
        raise ValueError(f"no statement of a law: {line}")
    target, sign, value = assigned.groups()
    value = _called(value)
    return f"{target} := {f'{target} {sign} ({value})' if sign else value};"


def _called(words: str) -> str:
    for name, function in (("absolute", "ABS"), ("least", "MIN"), ("most", "MAX")):
        words = re.sub(rf"\b{name}\(", f"{function}(", words)
    return words

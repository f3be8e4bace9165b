"""Random programs: sound moves or an error of one line, never anything else, and never for long."""

import math
import random

from jcontour.geometry.gcode.programs import interpreted
from jcontour.geometry.toolpath_rules import FARTHEST, FASTEST, ToolpathError
from jcontour.geometry.toolpath_text import lines_of

LETTERS = "XYZIJKRFPQLSTNDHEAUM@^"
CODES = (
    "0 1 2 3 2 3 1 1 17 18 19 20 21 90 91 90.1 91.1 93 94 54 55 59.3 28 30 28.1 53 52 92 92.1 92.2 "
    "92.3 10 4 43 43.1 49 61 64 73 80 81 82 83 84 85 86 88 89 98 99 40 41 38.2 5 33 95 7.5"
).split()
FUNCTIONS = "abs acos asin cos exp exists fix fup ln round sin sqrt tan".split()
OPERATORS = "+ - * / ** mod eq ne gt ge lt le and or xor".split()
NAMES = ("1", "2", "31", "100", "5220", "<a>", "<_b>", "5421", "<_x>", "9999", "[#1]", "#2")
NUMBERS = ("0", "1", "-1", ".5", "2.", "-.001", "10", "1e3", "99999", "1000000000", "", "1.2.3")
FLOWS = (
    "sub",
    "endsub",
    "endsub [{}]",
    "call",
    "call [{}] [{}]",
    "return",
    "return [{}]",
    "if [{}]",
    "elseif [{}]",
    "else",
    "endif",
    "while [{}]",
    "endwhile",
    "do",
    "repeat [{}]",
    "endrepeat",
    "break",
    "continue",
    "",
)
LAYOUT = (
    "",
    "%",
    "(a comment)",
    "; another",
    "/G1 X9",
    "(abort, no)",
    "M2",
    "M30",
    "M98 P1",
    "M99",
)
RIGHT = (
    "G1 X{} Y{} Z{}",
    "X{}Y{}",
    "G0 Z{} (up)",
    "G2 X{} Y{} R100",
    "g3 i{} j{}",
    "#1 = [{} * 2 + sin[{}]]",
    "G1 X#1 Y[#1 / 3]",
    "G81 X{} Y{} Z-20 R20",
    "G92 X{}",
    "o7 repeat [3]\nG91 G1 X{}\nG90\no7 endrepeat",
    "o8 if [{} gt {}]\nG1 Y{}\no8 else\nG1 Y1\no8 endif",
    "G55 G18 G2 X{} Z{} R200\nG17 G54",
    "#<a> = {}\n#2 = 31",
)
JUNK = "%()[]#<>;/=*é\x00\t ,:\"'\\"


def random_program(chance: random.Random) -> str:
    """Text of a program of up to 30 lines."""
    lines = [_line(chance) for _ in range(chance.choice((1, 2, 4, 8, 30)))]
    text = "\n".join(["G21 F600 G1 X1", *lines] if chance.random() < 0.7 else lines)
    if chance.random() < 0.2:
        where = chance.randrange(len(text) + 1)
        text = text[:where] + chance.choice(JUNK) + text[where + chance.randint(0, 2) :]
    return text


def _line(chance: random.Random) -> str:
    if chance.random() < 0.6:
        numbers = [f"{chance.uniform(-20, 20):.3f}" for _ in range(4)]
        return chance.choice(RIGHT).format(*numbers)
    kind = chance.random()
    if kind < 0.25:
        flow = chance.choice(FLOWS)
        values = [_expression(chance, 2) for _ in range(flow.count("{}"))]
        return f"o{chance.choice('123')} {flow}".format(*values)
    if kind < 0.4:
        return f"#{chance.choice(NAMES)} = {_value(chance, 2)}"
    if kind < 0.5:
        return chance.choice(LAYOUT)
    words = [f"G{chance.choice(CODES)}"] if chance.random() < 0.6 else []
    chosen = chance.sample(LETTERS[:8] if chance.random() < 0.8 else LETTERS, chance.randint(0, 5))
    words += [letter + _value(chance, 1) for letter in chosen]
    return " ".join(words)


def _value(chance: random.Random, depth: int) -> str:
    kind = chance.random()
    if kind < 0.5:
        return f"{chance.uniform(-20, 20):.3f}"
    if kind < 0.75:
        return chance.choice(NUMBERS)
    if kind < 0.85:
        return f"#{chance.choice(NAMES)}"
    return f"[{_expression(chance, depth)}]"


def _expression(chance: random.Random, depth: int) -> str:
    if depth == 0 or chance.random() < 0.3:
        return _value(chance, 0) if depth else str(chance.randint(-3, 9))
    left, right = _expression(chance, depth - 1), _expression(chance, depth - 1)
    if chance.random() < 0.3:
        called = chance.choice(FUNCTIONS)
        left = f"atan[{left}]/[{right}]" if chance.random() < 0.2 else f"{called}[{left}]"
    return f"{left} {chance.choice(OPERATORS)} {right}"


def assert_sound(program, axes):
    """Return whether the program runs."""
    try:
        moves = interpreted(lines_of(program), axes, None).moves
    except ToolpathError as error:
        assert len(str(error).splitlines()) == 1 and str(error).startswith("line "), program
        return False
    at = (0.0, 0.0, 0.0)
    for move in moves:
        gap = math.dist(at[:axes], move.start[:axes])
        assert gap < 1e-8, program
        assert all(abs(coordinate) <= FARTHEST for coordinate in (*move.start, *move.end))
        assert math.isnan(move.feed) == move.rapid, program
        assert move.rapid or 0 < move.feed <= 1.01 * FASTEST, program
        assert move.angle or math.dist(move.start[:axes], move.end[:axes]) > 0, program
        at = move.end
    return True


def test_a_thousand(monkeypatch):
    monkeypatch.setattr("jcontour.geometry.gcode.programs.MOST_REPEATED", 2000)
    chance = random.Random(15)
    ran = [assert_sound(random_program(chance), chance.choice((2, 3))) for _ in range(1000)]
    assert 100 < sum(ran) < 900  # both kinds are met

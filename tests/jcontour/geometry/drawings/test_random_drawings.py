"""Mutated drawings: a valid contour or one line, never anything else."""

import random
import re

import pytest

from jcontour.geometry.toolpath_rules import ToolpathError

BYTES = [b"-", b"9", b".", b"\n", b"1e300", b"<g>", b"\xff", b"\0", b"\n0\nLINE\n"]
WORDS = ["0", "-1", "1e-9", "1e-300", "1e300", "1e5", "180", "nan", "-7.5", "65536"]
NUMBERS = re.compile(rb'(?<=[\n\s",(])-?[0-9]+\.?[0-9]*(?=[\s,",)])')


def mutated(content: bytes, draw: random.Random) -> bytes:
    for _ in range(draw.randint(1, 4)):
        if draw.random() < 0.7:
            found = draw.choice(list(NUMBERS.finditer(content)))
            content = (
                content[: found.start()] + draw.choice(WORDS).encode() + content[found.end() :]
            )
        else:
            at = draw.randrange(len(content))
            kept = at + draw.choice([0, 0, 1, 20])
            content = content[:at] + draw.choice([*BYTES, b""]) + content[kept:]
    return content


@pytest.mark.parametrize("suffix", [".dxf", ".svg"])
def test_mutated_drawings(drawn, suffix):
    draw, taken = random.Random(1), 0
    original = (drawn.DATA / f"plate{suffix}").read_bytes()
    for _ in range(100):
        content = mutated(original, draw)
        try:
            drawn.read(content, 1e-3, suffix=suffix)
        except ToolpathError as error:
            assert len(str(error).splitlines()) == 1
        else:
            taken += 1
    assert 10 < taken < 90

"""Random contours under cutter compensation: lines and arcs, inside and outside corners."""

import cmath
import math
import random


def compensated_contour(seed: int, sides: int = 8) -> str:
    """Program of a contour with lead-in and lead-out, for a tool given by its diameter."""
    chance = random.Random(seed)
    code, diameter = chance.choice(("G41.1", "G42.1")), round(chance.uniform(0.5, 6.0), 3)
    lines = [f"G21 G90 G91.1 F600\nG0 X{chance.uniform(-9, 9):.4f} Y{chance.uniform(-9, 9):.4f}"]
    lines.append(f"{code} D{diameter}\nG91")
    direction = cmath.rect(1, chance.uniform(0, math.tau))
    for side in range(sides):
        if chance.random() < 0.8 or not side:
            direction *= cmath.rect(1, chance.gauss(0.0, 1.0))
        depth = f" Z{chance.uniform(-1, 1):.3f}" if chance.random() < 0.15 else ""
        if chance.random() < 0.5:
            step = chance.uniform(4.0, 20.0) * direction
            word = chance.choice(("G1", "G1", "G1", "G0"))
            lines.append(f"{word} X{step.real:.13f} Y{step.imag:.13f}{depth}")
            continue
        left, radius = chance.choice((True, False)), chance.uniform(4.0, 20.0)
        centre = radius * direction * (1j if left else -1j)
        sweep = chance.uniform(0.3, 4.0) * (1 if left else -1)
        step = centre - centre * cmath.rect(1, sweep)
        direction *= cmath.rect(1, sweep)
        words = f"X{step.real:.13f} Y{step.imag:.13f} I{centre.real:.13f} J{centre.imag:.13f}"
        lines.append(f"{'G3' if left else 'G2'} {words}{depth}")
        if chance.random() < 0.1:
            lines.append(
                f"Z{chance.uniform(-1, 1):.3f}\nG4 P.1"
                if False
                else f"G1 Z{chance.uniform(-1, 1):.3f}"
            )
    end = chance.uniform(10, 20) * direction
    lines.append(f"G40 G1 X{end.real:.6f} Y{end.imag:.6f}\nM2\n")
    return "\n".join(lines)

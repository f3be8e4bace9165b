"""Random programs of the G-code grammar that this reader and LinuxCNC's share."""

import math
import random

CYCLES = ("G81", "G82", "G83 Q{q}", "G73 Q{q}", "G85", "G86", "G89")


class Author:
    """Writes a program; follows as much of its state as the grammar needs to stay valid."""

    def __init__(self, seed: int):
        self.chance = random.Random(seed)
        self.lines: list[str] = []
        self.incremental = self.absolute_centres = False
        self.plane, self.depth, self.label = 17, 0, 100
        self.rotated = False

    def length(self, most: float = 30.0) -> float:
        """A coordinate."""
        return round(self.chance.uniform(-most, most), self.chance.choice((0, 1, 3, 5)))

    def value(self, number: float) -> str:
        """A number, or an expression that has its value."""
        kind = self.chance.randrange(8)
        if kind == 0:
            part = self.length(9.0)
            return f"[{number - part:.12f} + {part:.5f}]"
        if kind == 1:
            return f"[{2 * number:.12f} * sin[30]]"
        if kind == 2:
            return f"[{number:.12f} - #<_x> * 0]"
        if kind == 3:
            return f"[{number:.12f} + [#31 mod 1] * 0 - fix[0.5] + atan[0]/[1]]"
        return (
            f"{number:.6f}".rstrip("0").rstrip(".")
            if kind < 7
            else f"+{number + 0:.6f}".replace("+-", "-")
        )

    def program(self, size: int) -> str:
        """Text of a program of so many statements."""
        self.say("G21 G17 G90 G91.1 G94 G40 G49 G54 G80 G98 F600 M3 S9")
        self.say("G0 X1 Y2 Z3")
        for _ in range(size):
            self.statement()
        self.say("M2")
        return "\n".join(self.lines) + "\n"

    def say(self, line: str) -> None:
        """Write a line, now and then with a number, a comment, spaces or small letters."""
        if self.chance.random() < 0.1 and not line.lower().startswith("o"):
            line = f"N{len(self.lines)} {line}"
        if self.chance.random() < 0.1:
            line += self.chance.choice((" (a note)", " ; another"))
        if self.chance.random() < 0.1:
            line = line.lower()
        self.lines.append(line)

    def statement(self) -> None:
        """One statement, which may be a block of several lines."""
        kinds = [
            (self.line, 8),
            (self.arc_by_centre, 5),
            (self.arc_by_radius, 3),
            (self.cycle, 2),
            (self.mode, 3),
            (self.offset, 2),
            (self.home, 1),
            (self.flow, 2 if self.depth < 3 else 0),
            (self.dwell, 1),
            (self.parameters, 2),
        ]
        choices, weights = zip(*kinds, strict=True)
        self.chance.choices(choices, weights)[0]()

    def words(self, letters: str) -> str:
        """Some of the letters with coordinates."""
        some = [letter for letter in letters if self.chance.random() < 0.6] or [letters[0]]
        return " ".join(f"{letter}{self.value(self.length())}" for letter in some)

    def line(self) -> None:
        """G0, G1 or G53."""
        code = self.chance.choice(("G0", "G1", "G1", "G53 G0"))
        if code == "G53 G0" and self.incremental:
            code = "G1"
        self.say(f"{code} {self.words('XYZ')}")

    def arc_by_centre(self) -> None:
        """An arc from and to computed places: incremental, its radius exact to the last digit."""
        first, second, normal = {17: "XYZ", 18: "ZXY", 19: "YZX"}[self.plane]
        radius, begin = self.chance.uniform(1, 20), self.chance.uniform(0, math.tau)
        sweep = self.chance.choice((math.tau, self.chance.uniform(0.2, 6.0)))
        left = self.chance.random() < 0.5
        last = begin + sweep if left else begin - sweep
        i, j = -radius * math.cos(begin), -radius * math.sin(begin)
        du, dv = i + radius * math.cos(last), j + radius * math.sin(last)
        centres = {"X": "I", "Y": "J", "Z": "K"}
        words = [f"{centres[first]}{i:.13f}", f"{centres[second]}{j:.13f}"]
        if sweep != math.tau or self.chance.random() < 0.5:
            du, dv = (0.0, 0.0) if sweep == math.tau else (du, dv)
            words += [f"{first}{du:.13f}", f"{second}{dv:.13f}"]
        if self.chance.random() < 0.3:
            words.append(f"{normal}{self.value(self.length(5.0))}")
        if self.chance.random() < 0.2:
            words.append(f"P{self.chance.randint(1, 3)}")
        self.chance.shuffle(words)
        self.say("G91")
        if self.absolute_centres:
            self.say("G91.1")
        self.say(f"{'G3' if left else 'G2'} {' '.join(words)}")
        if self.absolute_centres:
            self.say("G90.1")
        if not self.incremental:
            self.say("G90")

    def arc_by_radius(self) -> None:
        """An arc by R, incremental."""
        first, second, _ = {17: "XYZ", 18: "ZXY", 19: "YZX"}[self.plane]
        du, dv = self.chance.uniform(1, 9), self.chance.uniform(-9, 9)
        radius = math.hypot(du, dv) * self.chance.uniform(0.51, 2.0)
        sign = self.chance.choice((1, -1))
        self.say("G91")
        code = self.chance.choice(("G2", "G3"))
        self.say(f"{code} {first}{du:.6f} {second}{dv:.6f} R{sign * radius:.6f}")
        if not self.incremental:
            self.say("G90")

    def cycle(self) -> None:
        """A canned cycle at some holes, from above R."""
        first, second, normal = {17: "XYZ", 18: "ZXY", 19: "YZX"}[self.plane]
        code = self.chance.choice(CYCLES).format(q=round(self.chance.uniform(0.5, 3), 3))
        dwell = f" P{self.chance.choice((0, 0.25))}" if code in ("G82", "G86", "G89") else ""
        back = self.chance.choice(("G98", "G99"))
        if not self.incremental:
            r = self.length(5.0)
            bottom = r - self.chance.uniform(0.5, 9)
            if self.chance.random() < 0.7:
                self.say(f"G0 {normal}{r + self.chance.uniform(0, 9):.4f}")
            depth = f"{normal}{bottom:.4f} R{r:.4f}"
        else:
            depth = f"{normal}{-self.chance.uniform(0.5, 9):.4f} R{self.length(5.0):.4f}"
        count = f" L{self.chance.randint(1, 3)}" if self.chance.random() < 0.3 else ""
        self.say(f"{back} {code} {first}{self.length()} {depth}{dwell}{count}")
        for _ in range(self.chance.randrange(3)):
            self.say(f"{self.words(first + second)}{count}")
        self.say("G80")

    def mode(self) -> None:
        """Distance, centres, plane, unit, path."""
        kind = self.chance.randrange(5)
        if kind == 0:
            self.incremental = not self.incremental
            self.say("G91" if self.incremental else "G90")
        elif kind == 1:
            self.absolute_centres = not self.absolute_centres
            self.say("G90.1" if self.absolute_centres else "G91.1")
        elif kind == 2:
            self.plane = 17 if self.rotated else self.chance.choice((17, 18, 19))
            self.say(f"G{self.plane}")
        elif kind == 3:
            self.say(self.chance.choice(("G61", "G61.1", "G64", "G64 P0.01")))
        else:
            self.say(f"G20 G1 {self.words('XY')}\nG21")

    def offset(self) -> None:
        """Work systems, G52, G92 and tool offsets."""
        kind = self.chance.randrange(8)
        system = self.chance.randint(1, 9)
        if kind == 0:
            turn = (
                f" R{self.length(90.0)}" if self.plane == 17 and self.chance.random() < 0.4 else ""
            )
            self.rotated |= bool(turn)
            self.say(f"G10 L2 P{system} {self.words('XYZ')}{turn}")
        elif kind == 1:
            self.say(f"G10 L20 P{system} {self.words('XYZ')}")
        elif kind == 2:
            if not (self.rotated and self.plane != 17):
                code = f"G{53 + system}" if system <= 6 else f"G59.{system - 6}"
                self.say(code)
        elif kind == 3:
            self.say(f"G92 {self.words('XYZ')}")
        elif kind == 4:
            self.say(self.chance.choice(("G92.1", "G92.2", "G92.3")))
        elif kind == 5:
            self.say(f"G43.1 {self.words('XYZ')}")
        elif kind == 6:
            self.say("G49")
        else:
            self.say(f"G52 {self.words('XYZ')}")

    def home(self) -> None:
        """G28 and G30."""
        code = self.chance.choice(("G28", "G30"))
        self.say(self.chance.choice((code, f"{code}.1", f"{code} {self.words('XYZ')}")))

    def dwell(self) -> None:
        """A rest."""
        self.say(f"G4 P{self.chance.uniform(0, 2):.3f}")

    def parameters(self) -> None:
        """Set some, and use them."""
        number = self.chance.randint(31, 99)
        self.say(f"#{number} = {self.value(self.length())} #<name> = {self.length()}")
        self.say(f"G1 X#{number} Y[#<name> / 2] Z[abs[#{number}] ** 0.5]")
        self.say("#<_x1>=[#5420 + #5421 + #<_z>]\nG1 X[#<_x1> - #5422 - #5421]")

    def flow(self) -> None:
        """Branches, loops and subprograms."""
        self.label += 1
        label, self.depth = self.label, self.depth + 1
        kept = self.incremental, self.absolute_centres, self.plane, self.rotated
        kind = self.chance.randrange(5)
        count = self.chance.randint(1, 3)
        if kind == 0:
            self.say(f"o{label} repeat [{count}]")
            self.step()
            self.say(f"o{label} endrepeat")
        elif kind == 1:
            self.say(f"#{label} = 0\no{label} while [#{label} lt {count}]")
            self.step()
            self.say(f"#{label} = [#{label} + 1]\no{label} endwhile")
        elif kind == 2:
            self.say(f"o{label} if [{self.length()} gt {self.length()}]")
            self.step()
            self.say(f"o{label} elseif [#31 ge {self.length()}]")
            self.step()
            self.say(f"o{label} else")
            self.step()
            self.say(f"o{label} endif")
        elif kind == 3:
            self.say(f"#{label} = 0\no{label} do\n#{label} = [#{label} + 1]")
            self.step()
            self.say(f"o{label} while [#{label} lt {count}]")
        elif self.depth == 1:
            self.say(f"o{label} sub")
            self.say("G1 X[#1 + 1] Y#2")
            self.step()
            self.say(f"o{label} endsub [#1 * 2]")
            self.say(f"o{label} call [{self.length()}] [{self.value(self.length())}]")
            self.say("G1 Z[#<_value> / 9]")
        self.incremental, self.absolute_centres, self.plane, self.rotated = kept
        self.depth -= 1

    def step(self) -> None:
        """Moves that keep the modes as they were."""
        for _ in range(self.chance.randint(1, 3)):
            self.chance.choice((self.line, self.arc_by_centre, self.arc_by_radius, self.dwell))()

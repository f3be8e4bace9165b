"""A bent reference as files: samples as CSV for a control that streams, moves as G-code."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour.app.files import run_folder
from jcontour.geometry.toolpath_rules import SLOWEST

LEAST_FEED = 6e4 * SLOWEST  # [mm/min]
EARLY = 1e-3  # of the time of a move: more of it, and the tool waits behind it
SPACINGS = (64, 32, 16, 8, 4, 2, 1)  # samples of a move
CHORD = 0.5e-6  # [m] that moves at their feeds may be away from the samples at the same time
NEAR = CHORD - 2e-9  # [m], as the digits of the feeds have their share
STILL = 2e-5  # [m/s]: what is slower, and stays where it is, rests
SAMPLES, PROGRAM = "reference.csv", "part.ngc"
# [mm] of G64, up to which a control may round the corners between moves: without it, LinuxCNC
# blends as far as its speed asks for
BLENDING = 0.001
LONGEST = 200  # characters of a comment; LinuxCNC reads lines of at most 255


class Step(NamedTuple):
    """A line of the program."""

    end: int | None  # number of the end that a move leads to; None of a dwell
    word: float  # F of a move [mm/min], P of a dwell [s]


def steps(places: Float[np.ndarray, "M m"], lasting: Float[np.ndarray, " moves"]) -> list[Step]:
    """Moves from place to place in their times, dwells where they stay.

    >>> steps(np.array([[0.0], [1.0], [1.0]]), np.array([0.1, 0.5]))
    [Step(end=1, word=600.0), Step(end=None, word=0.5)]

    Args:
        places: as the program has them [mm].
        lasting: time of every move [s].
    """
    written, late, rest = [], 0.0, 0.0  # late: of the program's clock
    ways = np.linalg.norm(np.diff(places, axis=0), axis=1)
    for end, (way, time) in enumerate(zip(ways, lasting, strict=True), start=1):
        if way == 0:
            rest += float(time)
            continue
        if rest:
            written.append(_dwell(rest - late))
            late += written[-1].word - rest
            rest = 0.0
        written.append(Step(end, max(float(f"{60 * way / (time - late):.6g}"), LEAST_FEED)))
        late += 60 * way / written[-1].word - float(time)
        if late < -EARLY * time:  # its feed would be too slow for a program
            late, rest = 0.0, -late
    return [*written, _dwell(rest - late)] if rest else written


def clock(
    places: Float[np.ndarray, "M m"], written: list[Step]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n m"]]:
    """Times [s] at which the program is at places [mm], between which it goes evenly."""
    at, times = [0], [0.0]
    for step in written:
        if step.end is None:
            times.append(times[-1] + step.word)
        else:
            way = float(np.linalg.norm(places[step.end] - places[at[-1]]))
            times.append(times[-1] + 60 * way / step.word)
        at.append(at[-1] if step.end is None else step.end)
    return np.array(times), places[at]


def _dwell(lasting: float) -> Step:
    return Step(None, float(f"{lasting:.9g}"))


class Moves(NamedTuple):
    """Straight moves through some of the samples."""

    ends: Float[np.ndarray, "M m"]  # their ends, the start first (M, m) [m]
    lasting: Float[np.ndarray, " moves"]  # time of every move (M-1,) [s]
    # largest distance of a sample from where the program is at its time, with the digits that it
    # has [m]; 0 of rapid moves, which have no way
    chord: float
    rapid: bool = False  # whether they are rapid moves
    asked: str = ""  # what is to be done before the first one, in words; empty for nothing

    @property
    def acceleration(self) -> float:
        """Largest of an axis [m/s^2] that takes it from one feed to the next, in half of both."""
        speed = np.diff(self.ends, axis=0) / self.lasting[:, None]
        between = (self.lasting[1:] + self.lasting[:-1]) / 2
        return float((np.abs(np.diff(speed, axis=0)) / between[:, None]).max(initial=0.0))

    @property
    def going(self) -> int:
        """How many of them go somewhere, in the digits of the program; the others are rests."""
        return int(np.any(np.diff(rounded(self.ends), axis=0) != 0, axis=1).sum())


def moves_through(position: Float[np.ndarray, "T m"], dt: float) -> Moves:
    """The longest moves from sample to sample that stay near those in between, at their times.

    So feeds change by as much as the samples accelerate in a move, and not by a jump. None of them
    is part of a rest and part of a motion; a rest is a move to where it is. Their ends have the
    digits of the program.
    """
    slow = np.linalg.norm(np.diff(position, axis=0), axis=1) < STILL * dt
    bounds = np.append(np.flatnonzero(slow[1:] != slow[:-1]) + 1, len(position) - 1)
    written = 1e-3 * rounded(position)
    at, ends = [0], [written[0]]
    while at[-1] < len(position) - 1:
        bound = int(bounds[np.searchsorted(bounds, at[-1], side="right")])
        resting = _away(ends[-1], ends[-1], position[at[-1] : bound + 1])
        if slow[at[-1]] and resting <= NEAR:
            last, place = bound, ends[-1]
        else:
            last = bound
            for samples in SPACINGS:  # the longest move that stays near the samples
                last = min(at[-1] + samples, bound)
                if _away(ends[-1], written[last], position[at[-1] : last + 1]) <= NEAR:
                    break
            place = written[last]
        at.append(last)
        ends.append(place)
    places, lasting = np.array(ends), np.diff(at) * dt
    return Moves(places, lasting, _apart(places, lasting, position, dt))


def _apart(ends: np.ndarray, lasting: np.ndarray, position: np.ndarray, dt: float) -> float:
    """Largest distance of the samples from the program at the same time [m]."""
    places = rounded(ends)
    times, at = clock(places, steps(places, lasting))
    sampled = dt * np.arange(len(position))
    on = np.stack([np.interp(sampled, times, axis) for axis in at.T], axis=1)
    return float(np.linalg.norm(position - 1e-3 * on, axis=1).max())


def _away(start: np.ndarray, end: np.ndarray, points: Float[np.ndarray, "k m"]) -> float:
    """Largest distance of samples from a move at constant speed through the same times [m]."""
    on = start + np.linspace(0.0, 1.0, len(points))[:, None] * (end - start)
    return float(np.linalg.norm(points - on, axis=1).max())


def save_samples(
    position: np.ndarray,
    dt: float,
    axes: Sequence[str],
    folder: Path,
    cut: Bool[np.ndarray, " T"] | None = None,
) -> None:
    """Time [s] and positions [mm] of every sample; last whether it is cut, where that is given."""
    columns = [dt * np.arange(len(position)), 1e3 * position]
    header = ["time_s", *(f"{axis}_mm" for axis in axes)]
    numbers = ["%.6f", *["%.7f"] * len(axes)]
    if cut is not None:
        columns, header, numbers = [*columns, cut], [*header, "cut"], [*numbers, "%d"]
    rows = np.column_stack(columns)
    run_folder.write(
        folder / SAMPLES,
        lambda path: np.savetxt(path, rows, numbers, ",", header=",".join(header), comments=""),
    )


def save_program(
    run: Sequence[Moves], axes: Sequence[str], folder: Path, head: Sequence[str] = ()
) -> None:
    """The moves as G-code in mm and mm/min; a dwell [s] where they stay at one place.

    It stops (M0) where something is to be done that its axes do not do.
    """
    start, *_ = _places(run[0], axes)
    lines = [f"({plain(text)})" for text in head]
    lines += [f"G21 G90 G64 P{BLENDING:g}", f"G0 {start}"]
    for moves in run:
        lines += [f"M0 ({plain(moves.asked)})"] if moves.asked else []
        lines += _lines(moves, axes)
    lines += ["M2", ""]
    run_folder.write(folder / PROGRAM, lambda path: path.write_text("\n".join(lines)))


def plain(text: str) -> str:
    """Text as a comment may hold it: short, ASCII, without parentheses.

    >>> plain("bracket (2).ngc, 20 \u00b5m")
    'bracket [2].ngc, 20 ?m'
    """
    ascii_only = text.encode("ascii", "replace").decode().translate(str.maketrans("();", "[],"))
    line = re.sub(r"[^ -~]", " ", ascii_only)
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 3]}..."


def rounded(ends: Float[np.ndarray, "M m"]) -> Float[np.ndarray, "M m"]:
    """Places [m] as the program has them [mm]."""
    return np.round(1e3 * ends, 5)


def _places(moves: Moves, axes: Sequence[str]) -> list[str]:
    """Ends of moves as words."""
    return [
        " ".join(f"{axis}{value:.5f}" for axis, value in zip(axes, end, strict=True))
        for end in rounded(moves.ends) + 0.0  # no -0
    ]


def _lines(moves: Moves, axes: Sequence[str]) -> list[str]:
    places = _places(moves, axes)
    if moves.rapid:
        return [f"G0 {place}" for before, place in pairwise(places) if place != before]
    return [
        f"G4 P{step.word:.9g}" if step.end is None else f"G1 {places[step.end]} F{step.word:.6g}"
        for step in steps(rounded(moves.ends), moves.lasting)
    ]

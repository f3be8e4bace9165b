"""A bent reference as files: samples as CSV for a control that streams, moves as G-code."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from experiments.files import run_folder
from jcontour.geometry.toolpath_rules import SLOWEST

SPACINGS = (64, 32, 16, 8, 4, 2, 1)  # samples of a move
CHORD = 0.5e-6  # [m] that moves at their feeds may be away from the samples at the same time
STILL = 2e-5  # [m/s]: what is slower, and stays where it is, rests
SAMPLES, PROGRAM = "reference.csv", "part.ngc"
# [mm] of G64, up to which a control may round the corners between moves: without it, LinuxCNC
# blends as far as its speed asks for
BLENDING = 0.001
LONGEST = 200  # characters of a comment; LinuxCNC reads lines of at most 255


class Moves(NamedTuple):
    """Straight moves through some of the samples.

    Attributes:
        ends: their ends, the start first (M, m) [m].
        lasting: time of every move (M-1,) [s].
        chord: largest distance of a sample from where they are at its time [m]; 0 of rapid moves,
            which have no way.
        rapid: whether they are rapid moves.
        asked: what is to be done before the first one, in words; empty for nothing.
    """

    ends: Float[np.ndarray, "M m"]
    lasting: Float[np.ndarray, " moves"]
    chord: float
    rapid: bool = False
    asked: str = ""

    @property
    def feed(self) -> Float[np.ndarray, " moves"]:
        """Speed of every move [m/s]."""
        return np.linalg.norm(np.diff(self.ends, axis=0), axis=1) / self.lasting

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
    is part of a rest and part of a motion; a rest is a move to where it is.
    """
    slow = np.linalg.norm(np.diff(position, axis=0), axis=1) < STILL * dt
    bounds = np.append(np.flatnonzero(slow[1:] != slow[:-1]) + 1, len(position) - 1)
    at, ends, chord = [0], [position[0]], 0.0
    while at[-1] < len(position) - 1:
        bound = int(bounds[np.searchsorted(bounds, at[-1], side="right")])
        resting = _away(ends[-1], ends[-1], position[at[-1] : bound + 1])
        if slow[at[-1]] and resting <= CHORD:
            last, place, away = bound, ends[-1], resting
        else:
            last, away = _farthest_move(ends[-1], position, at[-1], bound)
            place = position[last]
        at.append(last)
        ends.append(place)
        chord = max(chord, away)
    return Moves(np.array(ends), np.diff(at) * dt, chord)


def _farthest_move(
    start: np.ndarray, position: np.ndarray, at: int, bound: int
) -> tuple[int, float]:
    """Last sample of the longest move that stays near the samples, and how near [m]."""
    lasts = [min(at + samples, bound) for samples in SPACINGS]
    away = [_away(start, position[last], position[at : last + 1]) for last in lasts]
    near = next((k for k, size in enumerate(away) if size <= CHORD), len(lasts) - 1)
    return lasts[near], away[near]


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

    Args:
        run: sections of moves.
        axes: letters.
        folder: that the file comes to.
        head: lines of text at its begin.
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
    lines, rested = [], 0.0
    # of the places as they are written, so that every move takes its own time
    written = moves._replace(ends=1e-3 * rounded(moves.ends))
    feeds = 6e4 * np.maximum(written.feed, SLOWEST)
    for k, (place, feed) in enumerate(zip(places[1:], feeds, strict=True)):
        if place == places[k]:
            rested += moves.lasting[k]
            continue
        lines += [*_dwell(rested), f"G1 {place} F{feed:.6g}"]
        rested = 0.0
    return lines + _dwell(rested)


def _dwell(lasting: float) -> list[str]:
    return [f"G4 P{lasting:.6g}"] if lasting else []

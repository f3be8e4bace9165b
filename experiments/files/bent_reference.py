"""A bent reference as files: samples as CSV for a control that streams, moves as G-code."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from experiments.files import run_folder
from jcontour.geometry.toolpath_rules import SLOWEST

SPACINGS = (64, 32, 16, 8, 4, 2, 1)  # samples of a move
CHORD = 0.5e-6  # [m] that moves may be away from the samples between their ends
STILL = 2e-5  # [m/s]: what is slower, and stays where it is, rests
SAMPLES, PROGRAM = "reference.csv", "part.ngc"


class Moves(NamedTuple):
    """Straight moves through some of the samples.

    Attributes:
        ends: their ends, the start first (M, m) [m].
        lasting: time of every move (M-1,) [s].
        chord: largest distance of a sample from them [m].
    """

    ends: Float[np.ndarray, "M m"]
    lasting: Float[np.ndarray, " moves"]
    chord: float

    @property
    def feed(self) -> Float[np.ndarray, " moves"]:
        """Speed of every move [m/s]."""
        return np.linalg.norm(np.diff(self.ends, axis=0), axis=1) / self.lasting


def moves_through(position: Float[np.ndarray, "T m"], dt: float) -> Moves:
    """The longest moves from sample to sample that stay near those in between.

    None of them is part of a rest and part of a motion; a rest is a move to where it is.
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
    """Largest distance of points from a line [m]."""
    along = end - start
    share = (points - start) @ along / max(float(along @ along), 1e-30)
    on = start + np.clip(share, 0.0, 1.0)[:, None] * along
    return float(np.linalg.norm(points - on, axis=1).max())


def save_samples(position: np.ndarray, dt: float, axes: Sequence[str], folder: Path) -> None:
    """Time [s] and positions [mm] of every sample."""
    rows = np.column_stack([dt * np.arange(len(position)), 1e3 * position])
    header = ",".join(["time_s", *(f"{axis}_mm" for axis in axes)])
    numbers = ["%.6f", *["%.7f"] * len(axes)]
    run_folder.write(
        folder / SAMPLES,
        lambda path: np.savetxt(path, rows, numbers, ",", header=header, comments=""),
    )


def save_program(moves: Moves, axes: Sequence[str], folder: Path) -> None:
    """The moves as G-code in mm and mm/min; a dwell [s] where they stay at one place."""
    places = [
        " ".join(f"{axis}{value:.5f}" for axis, value in zip(axes, end, strict=True))
        for end in np.round(1e3 * moves.ends, 5) + 0.0  # no -0
    ]
    lines, rested = [], 0.0
    feeds = 6e4 * np.maximum(moves.feed, SLOWEST)
    for k, (place, feed) in enumerate(zip(places[1:], feeds, strict=True)):
        if place == places[k]:
            rested += moves.lasting[k]
            continue
        lines += [*_dwell(rested), f"G1 {place} F{feed:.6g}"]
        rested = 0.0
    lines += _dwell(rested)
    program = ["(bent by jcontour)", "G21 G90 G64", f"G0 {places[0]}", *lines, "M2", ""]
    run_folder.write(folder / PROGRAM, lambda path: path.write_text("\n".join(program)))


def _dwell(lasting: float) -> list[str]:
    return [f"G4 P{lasting:.6g}"] if lasting else []

"""A bent reference as files: samples as CSV for a control that streams, moves as G-code."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from experiments.files import run_folder

SPACINGS = (64, 32, 16, 8, 4, 2, 1)  # samples of a move
CHORD = 0.5e-6  # [m] that moves may be away from the samples between their ends
SLOWEST = 1e-3  # [mm/min], where the reference rests
SAMPLES, PROGRAM = "reference.csv", "part.ngc"


class Moves(NamedTuple):
    """Straight moves through some of the samples.

    Attributes:
        ends: their ends, the start first (M, m) [m].
        feed: of every move (M-1,) [m/s].
        chord: largest distance of a sample from them [m].
    """

    ends: Float[np.ndarray, "M m"]
    feed: Float[np.ndarray, " moves"]
    chord: float


def moves_through(position: Float[np.ndarray, "T m"], dt: float) -> Moves:
    """The longest moves from sample to sample that stay near those in between."""
    at, chord = [0], 0.0
    while at[-1] < len(position) - 1:
        ends = [min(at[-1] + samples, len(position) - 1) for samples in SPACINGS]
        away = [_away(position[at[-1] : end + 1]) for end in ends]
        near = next((k for k, size in enumerate(away) if size <= CHORD), len(ends) - 1)
        at.append(ends[near])
        chord = max(chord, away[near])
    ends = position[at]
    lengths = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    return Moves(ends, lengths / (np.diff(at) * dt), chord)


def _away(points: Float[np.ndarray, "k m"]) -> float:
    """Largest distance of points from the line between the first and the last [m]."""
    along = points[-1] - points[0]
    share = (points - points[0]) @ along / max(float(along @ along), 1e-30)
    on = points[0] + np.clip(share, 0.0, 1.0)[:, None] * along
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
    """The moves as G-code in mm and mm/min."""
    places = [
        " ".join(f"{axis}{1e3 * value:.5f}" for axis, value in zip(axes, end, strict=True))
        for end in moves.ends
    ]
    feeds = np.maximum(6e4 * moves.feed, SLOWEST)
    lines = [f"G1 {place} F{feed:.3f}" for place, feed in zip(places[1:], feeds, strict=True)]
    program = ["(bent by jcontour)", "G21 G90 G64", f"G0 {places[0]}", *lines, "M2", ""]
    run_folder.write(folder / PROGRAM, lambda path: path.write_text("\n".join(program)))

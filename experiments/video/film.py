"""A film of a run: its content, its maker, and the lines that tell a user of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jcontour.plant import Plant, State

MP4_NEEDS = "an MP4 needs `pip install 'jcontour[video]'`, or `uv run --extra video jcontour ...`"


class VideoError(ValueError):
    """A video that cannot be made; one line says why and what helps."""


class Film(NamedTuple):
    """Content of a film, sample by sample.

    Attributes:
        time: [s] (T,).
        pose: (T, n) of the machine, as its film maker watches it.
        tool: (T, 2) [m].
        error: (T, 2) [m], from the nearest point of the contour to the tool.
        path: (T, 2) [m], where the tool should be.
        title: heading of every frame.
    """

    time: np.ndarray
    pose: np.ndarray
    tool: np.ndarray
    error: np.ndarray
    path: np.ndarray
    title: str


class FilmMaker(NamedTuple):
    """Functions that film one machine.

    Attributes:
        watch: the pose (n,) of a plant in a state, traced; what a replay has to keep.
        record: writes the film into a folder, and returns its file, pace, seconds, and what is
            `magnified`, in words; raises `VideoError`.
    """

    watch: Callable[[Plant, State], Any]
    record: Callable[[Film, Path], dict[str, Any]]


def lines(video: dict[str, Any], folder: Path) -> list[str]:
    """Lines that tell a user of a recorded film."""
    file = video["file"]
    told = (
        f"Video: {folder / file}, {video['seconds']:.3g} s, {video['pace']}, {video['magnified']}"
    )
    return [told, f"It is a GIF: {MP4_NEEDS}"] if file.endswith(".gif") else [told]

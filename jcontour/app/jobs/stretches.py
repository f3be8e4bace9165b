"""Stretches of contours: moved, cut and measured; those that represent a long program."""

from math import comb

import jax
import numpy as np
from jaxtyping import Float

from jcontour.app.jobs.job import ENTRY, Job, Task, behind_entry
from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.contours import SMALLEST, from_pieces
from jcontour.geometry.pieces import Piece
from jcontour.motion.references import along

PLACES = 33  # of a piece at which its curvature is measured; smooth pieces change little between


def moved(contour: Contour, by: Float[np.ndarray, " m"]) -> Contour:
    """Contour moved by a vector [m]; lifted to the plane z = 0 first where that has more axes."""
    missing = by.size - contour.axes
    if missing < 0:
        raise ValueError(f"by: needs at least {contour.axes} axes, received {by.size}")
    pieces = unpadded(contour)
    polynomial = _widened(pieces.polynomial, missing)
    polynomial[:, 0] += by
    cosine, sine = _widened(pieces.cosine, missing), _widened(pieces.sine, missing)
    return _like(contour, pieces._replace(polynomial=polynomial, cosine=cosine, sine=sine))


def beginning(contour: Contour, length: float) -> Contour:
    """First stretch of a contour, of this length [m]; the contour itself where it is no longer."""
    if not length > 0:
        raise ValueError(f"length: needs to be above zero, received {length}")
    if length >= float(contour.length):
        return contour
    pieces = unpadded(contour)
    extent = np.minimum(pieces.extent, length - pieces.start)
    kept = extent > 0
    pieces = jax.tree.map(lambda rows: rows[kept], pieces._replace(extent=extent))
    return _like(contour, pieces)


def between(contour: Contour, low: float, high: float) -> Contour:
    """Stretch of a contour from one arc length to another [m], open; its arc length begins at 0."""
    length = float(contour.length)
    if not 0 <= low < high <= length * (1 + 1e-12):
        raise ValueError(f"low, high: needs 0 <= low < high <= {length:g}, received {low}, {high}")
    pieces = unpadded(contour)
    cut = np.clip(low - pieces.start, 0.0, pieces.extent)
    extent = np.minimum(pieces.extent, high - pieces.start) - cut
    kept = extent > SMALLEST
    # The same curves with their arc lengths counted from later places [m]
    degree = pieces.polynomial.shape[1]
    polynomial = np.zeros_like(pieces.polynomial)
    for i in range(degree):  # p(s + by) = sum_i c_i sum_j binomial(i, j) by^(i - j) s^j
        for j in range(i + 1):
            weight = comb(i, j) * cut ** (i - j)
            polynomial[:, j] += weight[:, None] * pieces.polynomial[:, i]
    c, s = (f(pieces.rate * cut)[:, None] for f in (np.cos, np.sin))
    cosine = pieces.cosine * c + pieces.sine * s
    sine = pieces.sine * c - pieces.cosine * s
    pieces = pieces._replace(polynomial=polynomial, cosine=cosine, sine=sine)._replace(
        extent=extent, start=pieces.start + cut - low
    )
    return _like(contour, jax.tree.map(lambda rows: rows[kept], pieces))


def greatest_curvature(contour: Contour) -> float:
    """Greatest curvature [1/m] on the pieces of a contour; corners between them have none."""
    pieces = jax.tree.map(lambda rows: rows[:, None], unpadded(contour))
    _, velocity, acceleration = pieces.jet(np.linspace(0.0, 1.0, PLACES) * pieces.extent)
    square = np.sum(velocity**2, axis=-1, keepdims=True)
    along = np.sum(acceleration * velocity, axis=-1, keepdims=True) / square * velocity
    return float(np.max(np.linalg.norm(acceleration - along, axis=-1) / square[..., 0]))


def corner_angles(contour: Contour) -> Float[np.ndarray, " corners"]:
    """Changes of direction [rad] between a piece and the next, around a closed contour."""
    pieces = unpadded(contour)
    before = pieces.jet(pieces.extent)[1]
    after = np.roll(pieces.jet(np.zeros(pieces.extent.size))[1], -1, axis=0)
    last = None if bool(contour.closed) else -1
    return angle_between(before[:last], after[:last])


def angle_between(
    one: Float[np.ndarray, "n m"], other: Float[np.ndarray, "n m"]
) -> Float[np.ndarray, " n"]:
    """Angles [rad] from 0 to pi between vectors, exact for small ones too."""
    one = one / np.linalg.norm(one, axis=1, keepdims=True)
    other = other / np.linalg.norm(other, axis=1, keepdims=True)
    difference, total = np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1)
    return 2.0 * np.arctan2(difference, total)


def curve_feed(contour: Contour, acceleration: float) -> float:
    """Fastest feed [m/s] at which no curve needs more than this acceleration [m/s^2].

    That is |c| v^2 = a with the greatest curvature c [1/m]; infinite on straight lines. Corners
    are left out: the velocity jumps there at any feed.
    """
    bend = greatest_curvature(contour)
    return float(np.sqrt(acceleration / bend)) if bend > 0 else np.inf


def shortened(job: Job, samples: int) -> Job:
    """Beginning of a run at constant feed: its entry, and as many samples that are scored.

    A run without that many samples stays as it is.
    """
    if job.samples <= samples:
        return job
    arc = job.arc[: ENTRY + samples]
    return job._replace(arc=arc, scored=behind_entry(arc.size))


def _like(contour: Contour, pieces: Piece) -> Contour:
    return from_pieces(pieces, float(contour.fit_error), contour.newton_steps)


def _widened(rows: np.ndarray, columns: int) -> np.ndarray:
    return np.concatenate([rows, np.zeros((*rows.shape[:-1], columns))], axis=-1)


LONG = 10_000  # samples of a program that is tuned by stretches
WINDOW = 1000  # samples of a stretch
COUNT = 8  # stretches of a program
MARGIN = 20  # samples of path beyond both ends, for preview and errors along the path


def representatives(task: Task, dt: float) -> list[Task]:
    """Stretches of a long program, in its order; the task itself where it is not long.

    It is tuned on them, and tried as a whole afterwards. It is looked at in overlapping windows.
    Each has features: how much the path turns in all and at most, how fast it goes, how hard it
    accelerates, and in which directions. The window with the hardest acceleration comes first, then
    always the one that differs most from those before. A stretch is entered in motion, and its
    entry is not scored.
    """
    if not isinstance(task, Job) or task.samples <= LONG:
        return [task]
    starts = np.arange(0, task.samples - WINDOW - MARGIN, WINDOW // 2)
    scored = np.array([task.scored[a + ENTRY : a + WINDOW].any() for a in starts])
    moving = np.array([task.arc[a + WINDOW] > task.arc[a] for a in starts])
    starts = starts[scored & moving]
    if starts.size == 0:
        return [task]
    # Features of the windows, each divided by its largest
    reference = along(task.contour, task.arc, dt, 0, task.at_rest)
    tangent, arc = np.asarray(reference.tangent), task.arc
    speed = np.diff(arc, append=arc[-1]) / dt
    velocity = speed[:, None] * tangent
    acceleration = np.linalg.norm(np.diff(velocity, axis=0, append=velocity[-1:]), axis=1) / dt
    turned = np.linalg.norm(np.diff(tangent, axis=0, append=tangent[-1:]), axis=1)
    rows = starts[:, None] + np.arange(WINDOW)
    direction = tangent[rows]
    outer = np.mean(direction[..., :, None] * direction[..., None, :], axis=1)
    columns = [
        np.sqrt(np.mean(acceleration[rows] ** 2, axis=1)),
        np.log1p(np.sum(turned[rows], axis=1)),
        np.max(turned[rows], axis=1),
        np.mean(speed[rows], axis=1),
        *outer.reshape(starts.size, -1).T,
    ]
    features = np.stack(columns, axis=1)
    chosen = starts[_spread(features / np.maximum(np.max(np.abs(features), axis=0), 1e-300), COUNT)]
    stretches = []
    for number, first in enumerate(np.sort(chosen).tolist(), start=1):
        last = first + WINDOW - 1
        low = float(arc[max(first - MARGIN, 0)])
        high = float(arc[min(last + MARGIN, task.samples - 1)])
        stretch = task._replace(
            name=f"{task.name} {number}",
            contour=between(task.contour, low, high),
            arc=arc[first : last + 1] - low,
            scored=task.scored[first : last + 1] & behind_entry(WINDOW),
            at_rest=False,
            program=None,
            aside=task.aside and task.aside.some(slice(first, last + 1)),
            planned=None,
            settling=0,
        )
        stretches.append(stretch)
    return stretches


def _spread(features: Float[np.ndarray, "w f"], count: int) -> list[int]:
    """Hardest acceleration first, then the rows that are farthest from all before."""
    chosen = [int(np.argmax(features[:, 0]))]
    distance = np.linalg.norm(features - features[chosen[0]], axis=1)
    while len(chosen) < min(count, len(features)) and distance.max() > 0:
        chosen.append(int(np.argmax(distance)))
        away = np.linalg.norm(features - features[chosen[-1]], axis=1)
        distance = np.minimum(distance, away)
    return chosen

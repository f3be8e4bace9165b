"""The frequency response of an axis as its record shows it, whatever the order of its model.

From periodic parts of a record comes the best linear approximation, else `measured` has spectra.

Of section s (one realisation at one level) with P periods of N samples, spectra U_p, Y_p of the
differences over each period, in which no slow move leaks,

    G_s = mean(Y_p) / mean(U_p),      G = sum_s w_s G_s / sum_s w_s,      w_s = |mean(U_p)|^2

Between periods G_s varies by noise alone, between sections by noise and by what is not linear: the
total variance of G is the larger of both (Pintelon & Schoukens, System Identification, 2nd ed.,
section 4.3). The excitation is periodic under feedback too, so that no noise correlates with it.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex, Float
from scipy.ndimage import uniform_filter1d
from scipy.signal import coherence, csd, fftconvolve, welch
from scipy.stats import norm

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.output_error import AxisRecord, simulated
from tuning.identification.linear.rigid_axis import Simple
from tuning.identification.linear.validation import (
    CONFIDENCE,
    HIDDEN,
    HIGHEST,
    POINTS,
    SHOWN,
    Response,
    noise_of,
)

SHORTEST = 0.25  # [s] of a period
SMOOTH = 5e-3  # [s] of differences that are looked at for periods: over less there is mostly noise
LEVEL = 0.5  # [s] over which its size is taken
STILL = 1e-6  # of its largest size: what running sums leave of a command that does not bend
ALIKE = 0.25  # least correlation of a record with itself a period later: root of the sum of r^2
ASKED = 0.1  # of its command: it is asked to, and does not ring
PARTS, NEARLY = 10, 0.8  # of a time of several periods at most; of the largest correlation
LOUDER = 1.7  # times: another level of a command
NEARBY = 4  # samples by which a correlation may miss a period
SAME = 0.9  # of the largest local correlation, within a section
MARGIN = 0.2  # of a period that is left out at either end of a section
FEWEST = 2  # periods of a section
BESIDE = 3  # lines on either side with which a line is compared, and its variance averaged
LEAST = 1e-6  # of the largest spectral line: the rest is rounding
SEEN = 20.0  # times its variance between periods: the power of a command that is excited
EXCITED = 0.1  # of the largest power beside it
FACTOR = 2.0  # deviations of a complex number within 95 % of its errors
SHARP = 0.05  # damping below which a mode is narrower than the grid
AROUND = np.array([-8.0, -4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 8.0])  # half widths of a peak
WINDOW = 1.05  # ratio of frequencies around a place that its interval holds
GAP, SPACING = 0.2, 5.0  # of a frequency, or [Hz]: between lines no resonance hides
# of a frequency, or [Hz], on either side of a line: a mode of damping 0.05 is wider
NEAR, NEAR_HZ = 0.04, 2.5
DIFFER = 3.0  # deviations of a mean square
# widest interval, relative, of a line that is kept: by itself, and averaged with its neighbours
FAINT, CLEAR = 2.0, 0.7


Sections = list[tuple[int, int]]  # first sample and number of periods of each
NO_LINES = Response(np.zeros(0), np.zeros(0, complex), np.zeros(0))


def averaged(lines: Response, model: AxisModel) -> Response:
    """Lines averaged with their neighbours, relative to a model.

    Beside a model the true response is smooth. Over `NEAR` of a frequency, or `NEAR_HZ`, on either
    side

        r = sum_k w_k G_k / G_m(f_k) / sum_k w_k,    w_k = |G_m(f_k) / G_k|^2 / var G_k
    with the variance max(1, c) / sum_k w_k, c the mean of w_k |G_k / G_m(f_k) - r|^2. Where c tells
    that the lines differ by more than their errors a line stands for itself: a mode hides there.
    """
    own = lines.value / model.response(2 * np.pi * lines.frequency)
    weight = 1 / np.maximum(np.abs(own) * lines.half_width / FACTOR, 1e-9) ** 2
    value, half = lines.value.copy(), lines.half_width.copy()
    for k, hertz in enumerate(lines.frequency):
        near = np.abs(lines.frequency - hertz) <= max(NEAR * hertz, NEAR_HZ)
        total, count = weight[near].sum(), np.count_nonzero(near)
        mean = (weight[near] @ own[near]) / total
        apart = float(weight[near] @ np.abs(own[near] - mean) ** 2) / max(count - 1, 1)
        if count < 2 or apart > 1 + DIFFER / np.sqrt(count - 1):
            continue
        value[k] *= mean / own[k]
        half[k] = FACTOR * np.sqrt(max(apart, 1.0) / total) / np.abs(mean)
    return Response(lines.frequency, value, half)


def clear_of(lines: Response) -> Response:
    """Lines that say what the response is; others, of an antiresonance, say how much at most."""
    clear = lines.half_width < CLEAR
    return Response(lines.frequency[clear], lines.value[clear], lines.half_width[clear])


def response_of_lines(lines: Response, model: AxisModel) -> Response:
    """The response of a model with an interval that every line around lies in.

    Between lines that are far apart, and above the last one, where more the higher the frequency
    is, that of a hidden resonance stands: of the model, or of a mass as large as the last line is
    where that is more, as a resonance that a gap softens is found too low.
    """
    hertz, dt = lines.frequency, model.dt
    usual = np.geomspace(hertz[0] / 2, HIGHEST / (2 * dt), POINTS)
    places = np.unique(np.concatenate([usual, _around_modes(model)]))
    off = np.abs(lines.value / model.response(2 * np.pi * hertz) - 1)
    own = off + lines.half_width * np.abs(lines.value) / np.abs(model.response(2 * np.pi * hertz))
    first = np.searchsorted(hertz, places / WINDOW)
    last = np.searchsorted(hertz, places * WINDOW, side="right")
    above = np.clip(np.searchsorted(hertz, places), 1, len(hertz) - 1)
    gap = hertz[above] - hertz[above - 1]
    value = model.response(2 * np.pi * places)
    mass = np.abs(lines.value[-1]) * (hertz[-1] / places) ** 2 / np.abs(value)
    more = np.maximum(mass, 1.0) if model.integrators else 1.0
    above_all = np.where(places > hertz[-1], more * places / hertz[-1], 1.0)
    width = HIDDEN / 2 * above_all
    known = (gap < np.maximum(GAP * places, SPACING)) | (places <= hertz[0])
    for k in np.flatnonzero((places <= hertz[-1]) & known):
        around = slice(min(first[k], above[k] - 1), max(last[k], above[k] + 1))
        width[k] = own[around].max()
    return Response(places, value, width)


def agreed_to(lines: Response, model: AxisModel) -> float:
    """Frequency [Hz] below which no line is off the model by more than its interval and `SHOWN`."""
    off = np.abs(model.response(2 * np.pi * lines.frequency) / lines.value - 1)
    missed = lines.frequency[off > lines.half_width + SHOWN]
    return float(missed.min(initial=np.inf))


def _around_modes(model: AxisModel) -> Float[np.ndarray, " F"]:
    """Frequencies [Hz] at and around the sharp peaks of a model."""
    rates = np.log(model.poles[np.imag(model.poles) > 0]) / model.dt
    size = np.abs(rates)
    damping = -np.real(rates) / size
    sharp = damping < SHARP
    places = size[sharp, None] * (1 + damping[sharp, None] * AROUND) / (2 * np.pi)
    return places.ravel()


def periodic_lines(record: AxisRecord) -> Response:
    """Lines at which periods of the record show the response; none of a record without periods.

    Of several levels the one with the least total variance counts, line by line: noise hides small
    motion, and a gap stays closed in it.
    """
    rows, sections = _periodic(record)
    if not sections:
        return NO_LINES
    levels = [_level(record, rows, part) for part in _by_level(record, rows, sections)]
    value, variance, power, floor = (np.stack(part) for part in zip(*levels, strict=True))
    shown = np.where(power > floor, power, 0.0)
    near = np.max([np.roll(shown, k, axis=1) for k in range(-BESIDE, BESIDE + 1)], axis=0)
    # what is not linear moves other lines, the less the smaller the motion
    other = np.maximum(power, floor) < EXCITED * near
    excited = shown.any(axis=0) & ~other.any(axis=0)
    hertz = np.fft.rfftfreq(rows, record.dt)
    kept = np.flatnonzero(excited & (hertz > 0) & (hertz < 0.45 / record.dt))
    hertz, value = hertz[kept], value[:, kept]
    size = np.maximum(np.median(np.abs(value), axis=0), 1e-300)
    relative, faint = variance[:, kept] / size**2, (FAINT * np.abs(value) / size) ** 2
    seen = (shown[:, kept] > 0) & (relative < faint)
    beside = {"size": 2 * BESIDE + 1, "axis": 1, "mode": "nearest"}
    # by chance one of many that are not looks clear; a running sum rounds below zero
    clear = uniform_filter1d(seen.astype(float), **beside) > 0.99
    averaged = np.maximum(uniform_filter1d(np.where(seen, relative, 0.0), **beside), 0.0)
    mean = np.where(clear, averaged, np.maximum(relative, faint))
    best = np.argmin(mean, axis=0), np.arange(len(kept))
    half = FACTOR * np.sqrt(mean[best]) * size / np.abs(value[best])
    ends = np.flatnonzero(half < CLEAR)
    if not ends.size:
        return NO_LINES
    sure = half < FAINT
    sure[: ends[0]] = sure[ends[-1] + 1 :] = False  # faint ones show where clear ones are around
    return Response(hertz[sure], value[best][sure], half[sure])


def _periodic(record: AxisRecord) -> tuple[int, Sections]:
    """Samples of a period, and the sections that repeat it; none where the command does not."""
    shapes = list(_shapes(record))
    rows = _period(shapes, record.dt)
    parts = [list(_sections(shape, rows)) if rows else [] for shape in shapes]
    sections = max(parts, key=lambda part: _repeated(record, rows, part))
    pairs = [np.split(shapes[0][start : start + 2 * rows], 2) for start, _ in sections]
    if not any(one @ two > ASKED * (one @ one) for one, two in pairs):
        return 0, []
    near = range(rows - NEARBY, rows + NEARBY + 1)
    return max(near, key=lambda one: _repeated(record, one, sections)), sections


def _repeated(record: AxisRecord, rows: int, sections: Sections) -> float:
    """Logarithm of a line's power over what differs from period to period, summed over periods."""
    total = 0.0
    for signal in (record.command, record.position):
        for start, count in sections:
            each = _spectra(signal, rows, start, count)[:, 1:]
            power = np.sum(np.abs(each) ** 2, axis=0)
            apart = np.sum(np.abs(each - each.mean(axis=0)) ** 2, axis=0)
            least = LEAST * power.max() + 1e-300
            ratio = (power + least) / (apart + least) * (1 - 1 / len(each))  # 1 of noise
            total += len(each) * float(np.mean(np.log(ratio)))
    return total


def _spectra(
    signal: Float[np.ndarray, " T"], rows: int, start: int, count: int
) -> Complex[np.ndarray, "P L"]:
    """Of the differences over each period."""
    count = min(count, (len(signal) - start - 1) // rows)
    return np.fft.rfft(np.diff(signal[start : start + count * rows + 1]).reshape(count, rows))


def _by_level(record: AxisRecord, rows: int, sections: Sections) -> list[Sections]:
    """Sections of about one level; all together where one has no other beside it."""
    smooth, sizes = uniform_filter1d(record.command, max(round(SMOOTH / record.dt), 1)), []
    for start, count in sections:
        U = _spectra(smooth, rows, start, count)[:, 1:]
        mean, own = U.mean(axis=0), np.sum(np.abs(U - U.mean(axis=0)) ** 2)
        power = np.sum(np.abs(mean) ** 2) - own / (len(U) * (len(U) - 1))  # without its noise
        sizes.append(np.log(max(power, 1e-300)) / 2)
    order = np.argsort(sizes)
    apart = np.flatnonzero(np.diff(np.array(sizes)[order]) > np.log(LOUDER)) + 1
    groups = [[sections[k] for k in part] for part in np.split(order, apart)]
    return groups if min(map(len, groups)) > 1 else [sections]


def _level(record: AxisRecord, rows: int, sections: Sections) -> list[np.ndarray]:
    """G of every line, its variance, the power of the command and how much of it noise may be."""
    values, weights, noise, own = [], [], [], []
    for start, count in sections:
        U, Y = (_spectra(one, rows, start, count) for one in (record.command, record.position))
        count = len(U)  # those of the record
        U_mean = U.mean(axis=0)
        U_mean = np.where(np.abs(U_mean) > LEAST * np.abs(U_mean).max(), U_mean, np.inf)
        G = Y.mean(axis=0) / U_mean
        scatter = (np.abs((Y - G * U) / U_mean) ** 2).sum(axis=0)
        values.append(G)
        weights.append(np.where(np.isfinite(U_mean), np.abs(U.mean(axis=0)) ** 2, 0.0))
        noise.append(scatter / (count * (count - 1)))
        own.append((np.abs(U - U.mean(axis=0)) ** 2).sum(axis=0) / (count * (count - 1)))
    G, w, noise = (np.array(part) for part in (values, weights, noise))
    w = w / np.maximum(w.sum(axis=0), 1e-300)
    value = (w * G).sum(axis=0)
    variance = (w**2 * noise).sum(axis=0)
    if len(sections) > 1:
        spread = (w**2 * np.abs(G - value) ** 2).sum(axis=0)
        variance = np.maximum(variance, spread * len(sections) / (len(sections) - 1))
    return [value, variance, np.sum(weights, axis=0), SEEN * np.sum(own, axis=0)]


def _period(shapes: list[Float[np.ndarray, " _"]], dt: float) -> int:
    """Samples after which signals are most alike themselves, by the sum of r^2; 0 if hardly."""
    least, most = round(SHORTEST / dt), min(map(len, shapes)) // (FEWEST + 1)
    if most <= least:
        return 0
    alike = np.zeros(most - least)
    for shape in shapes:
        count = len(shape)
        overlap = fftconvolve(shape, shape[::-1])[count - 1 + least : count - 1 + most]
        r = overlap / (np.arange(count - least, count - most, -1) * np.mean(shape**2) + 1e-300)
        alike += np.maximum(r, 0.0) ** 2
    found = int(np.argmax(alike))
    # several periods later they are about as alike: the shortest whole part counts
    for part in range(PARTS, 1, -1):
        near = round((least + found) / part) - least + np.arange(-2, 3)
        near = near[near >= 0]
        if near.size and alike[near].max() > NEARLY**2 * alike[found]:
            found = int(near[np.argmax(alike[near])])
            break
    return least + found if alike[found] > ALIKE**2 else 0


def _shapes(record: AxisRecord) -> Iterator[Float[np.ndarray, " T"]]:
    """What may repeat: second differences of the command and of the position, over their sizes."""
    level, step = round(LEVEL / record.dt), max(round(SMOOTH / record.dt), 1)
    for signal in (record.command, record.position):
        smooth = uniform_filter1d(signal, step)
        bent = uniform_filter1d(
            smooth[2 * step :] - 2 * smooth[step:-step] + smooth[: -2 * step], step
        )
        size = np.sqrt(np.maximum(uniform_filter1d(bent**2, level), 0.0))
        yield bent / np.maximum(size, STILL * size.max() + 1e-300)


def _sections(signal: Float[np.ndarray, " T"], rows: int) -> Iterator[tuple[int, int]]:
    """First sample and number of periods of each part that repeats."""
    window = np.ones(rows)
    ahead = fftconvolve(signal[:-rows] * signal[rows:], window, "valid")
    size = np.sqrt(np.maximum(fftconvolve(signal**2, window, "valid"), 1e-300))
    alike = ahead / (size[: len(ahead)] * size[rows : rows + len(ahead)])
    same = alike > SAME * np.percentile(alike, 95)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    margin = round(MARGIN * rows)
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        begin, end = first + margin, last + 2 * rows - margin
        count = (end - begin) // rows
        if count >= FEWEST:
            yield int(begin + end - count * rows) // 2, int(count)


SEGMENTS = 16  # at least
LONGEST = 2.0  # [s] of a segment: lines of 0.5 Hz
FED_BACK = 2.0  # gain of the loop that recorded, where it matters: around its bandwidth
WIDEST = 0.3  # widest 95 % interval, relative, of a line that is kept
ABOVE = 3.0  # times the noise of the encoder: less is no motion
CHANCE = 1e-3  # of two signals that have nothing in common
TOGETHER = 5.0  # deviations of a mean over all lines


def measured(simple: Simple) -> Response:
    """Lines at which a record shows the response by itself; none where it shows it nowhere.

        G = G_m S_ym / S_mm,
        var G / |G|^2 = (1 - g^2) / (2 n g^2),    g^2 = |S_ym|^2 / (S_yy S_mm)
    (Bendat & Piersol, Random Data, 4th ed., section 9.1) of n segments, where m is what a model G_m
    answers to the command and to friction: beside it the true response is smooth, so that a window
    blurs it little. Both signals are differenced, which changes no ratio and takes the drift of an
    integrator away. Under feedback, what is not the command's answer pulls G towards the inverse of
    the controller, relative to G by |L| (1 - g^2) / g^2 with the loop gain L: an interval is wider
    by that with |L| = `FED_BACK`.

    Args:
        simple: model G_m of the record, and how much of each drag there is.
    """
    record, fit = simple.record, simple.fit
    answer = simulated(record, fit.model, drag=fit.drag).output
    rows = min(round(LONGEST / record.dt), len(answer) // SEGMENTS)
    count = len(answer) // rows
    m, y = np.diff(answer), np.diff(record.position)
    hertz, of_m = welch(m, 1 / record.dt, nperseg=rows)
    _, of_y = welch(y, 1 / record.dt, nperseg=rows)
    _, both = csd(m, y, 1 / record.dt, nperseg=rows)
    with np.errstate(divide="ignore", invalid="ignore"):
        value, part = both / of_m, np.abs(both) ** 2 / (of_m * of_y)
        left = np.maximum(1 - part, 0.0) / part
        half = float(norm.ppf((1 + CONFIDENCE) / 2)) * np.sqrt(left / (2 * count)) + FED_BACK * left
    # where only noise of the encoder moves, under feedback, both are alike: the controller answers
    floor = (
        noise_of(record.position) ** 2
        * 2
        * record.dt
        * (2 * np.sin(np.pi * hertz * record.dt)) ** 2
    )
    kept = (half < WIDEST) & (hertz > 0) & (of_y > ABOVE * floor)
    G = fit.model.response(2 * np.pi * hertz[kept])
    return Response(hertz[kept], value[kept] * G, half[kept])


def related(record: AxisRecord) -> bool:
    """Whether command and position have more in common than chance gives, at one line or at all.

    Of n segments of noise g^2 is larger than x by a chance of (1 - x)^(n - 1): minus its logarithm
    has mean 1 and deviation 1, and neighbouring lines share half of it.
    """
    rows = len(record.position) // SEGMENTS
    _, common = coherence(np.diff(record.command), np.diff(record.position), nperseg=rows)
    unlikely = -(SEGMENTS - 1) * np.log(np.maximum(1 - np.nan_to_num(common), 1e-300))
    count = len(unlikely)
    everywhere = unlikely.mean() > 1 + TOGETHER * np.sqrt(2 / count)
    return bool(unlikely.max() > np.log(count / CHANCE) or everywhere)

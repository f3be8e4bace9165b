from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from jcontour.linear.continuous_axes import (
    position_axis,
    sampled_axis,
    speed_axis,
    with_resonance,
)
from tuning.identification.linear import order_search
from tuning.identification.linear.noise_model import whitening
from tuning.identification.linear.order_search import (
    TELLS,
    Candidate,
    Choice,
    chosen,
    of_fewer_poles,
    settled,
)
from tuning.identification.linear.output_error import (
    AxisRecord,
    Structure,
    fitted,
    predicted,
    structure_of,
)
from tuning.identification.linear.recording import RecordedAxis, recorded

DT = 1e-3


def logged(axis, takes, gain, rows, seed=0):
    """A record in closed loop, with steps of the reference."""
    random = np.random.default_rng(seed)
    reference = np.repeat(random.uniform(-0.01, 0.01, rows // 60), 60)
    one = RecordedAxis(axis, takes, 1e-6, 0.5e-6, 1e-3, (gain,))
    return AxisRecord(DT, *recorded(one, reference, DT, random))


@pytest.mark.slow
@pytest.mark.parametrize("rows", [6000, 12_000])
@pytest.mark.parametrize("delay", [0, 3])
@pytest.mark.parametrize("takes", ["speed", "position"])
def test_order_and_delay_of_a_drive_in_closed_loop(takes, delay, rows):
    make, i = (speed_axis, 1) if takes == "speed" else (position_axis, 0)
    axis = make(0.8, 0.015, delay * DT)
    record = logged(axis, takes, 10.0 if takes == "speed" else 1.2, rows)
    choice = chosen(record, (0, 1), 3, 6)
    found = settled(record, choice.best.fit, 6)
    structure = structure_of(found.fit.model)
    assert (structure.integrators, structure.poles, structure.delay) == (i, 1, delay)
    A, B, C, late = sampled_axis(axis, DT)
    w = 2 * np.pi * np.geomspace(0.5, 100, 20)
    z = np.exp(1j * w * DT)
    truth = [(C @ np.linalg.solve(v * np.eye(len(A)) - A, B)).item() * v**-late for v in z]
    assert np.abs(found.fit.model.response(w) / truth - 1).max() < 0.01


def test_noise_alone_has_no_model_of_order():
    """Pure noise as position: the smallest structure is taken, it predicts as well as any."""
    random = np.random.default_rng(3)
    record = AxisRecord(DT, random.standard_normal(3000), random.standard_normal(3000))
    best = chosen(record, (0, 1), 3, 2).best
    assert best.structure.poles + best.structure.zeros <= 2


def test_a_richer_model_that_the_record_makes_likelier_is_kept_in_mind():
    """A resonance that a slow motion with a few corners shows: against the model without it."""
    axis = with_resonance(position_axis(0.9, 0.018, DT), 2 * np.pi * 60, 0.1)
    one = RecordedAxis(axis, "position", 0.5e-6, 0.2e-6, 1e-3, (1.2,))
    reference = 0.05 * DT * np.cumsum(np.sign(np.sin(2 * np.pi * 2.5 * DT * np.arange(6000))))
    record = AxisRecord(DT, *recorded(one, reference, DT, np.random.default_rng(2)))
    training, rest = record.part(0, 4200), record.part(4200, 6000)
    found = []
    for poles in (1, 3):
        fit = fitted(training, Structure(poles, poles, 0, 1))
        fit = fitted(
            training, Structure(poles, poles, 0, 1), whitening(fit.residual, 60), fit.model
        )
        found.append(Candidate(fit, predicted(rest, fit, fit.filter)))
    plain, rich = found
    assert Choice(plain, found).richer == [rich]
    assert Choice(rich, found).richer == []


def test_models_of_the_delays_that_are_not_told_apart_are_kept():
    """A smooth motion hides the delay; each other one comes with a model fitted to it."""
    random = np.random.default_rng(3)
    u = np.sin(2 * np.pi * 0.8 * 1e-3 * np.arange(4000))
    y = np.asarray(lfilter([0, 0, 0, 0.1], [1.0, -0.9], u)) + 1e-3 * random.standard_normal(4000)
    record = AxisRecord(1e-3, u, y)
    found = settled(record, fitted(record, Structure(1, 1, 0, 2)), 5)
    near = {d for d, value in found.rivals.items() if value < TELLS}
    assert near and {one.delay for one in found.equals} == near
    at = np.array([2 * np.pi * 0.8])
    for one in found.equals:  # all say the same where the motion was
        assert np.abs(one.response(at) / found.fit.model.response(at) - 1) < 0.01


def one_pole_fits(*all_poles):
    """Of an axis of one pole at 0.9 with white commands: fits with so many poles each."""
    random = np.random.default_rng(7)
    u = random.standard_normal(6000)
    y = np.asarray(lfilter([0.0, 1.0], [1.0, -0.9], u)) + 0.1 * random.standard_normal(6000)
    record = AxisRecord(DT, u, y)
    training, rest = record.part(0, 4200), record.part(4200, 6000)
    fits = [fitted(training, Structure(n, n, 0, 0)) for n in all_poles]
    return [Candidate(fit, predicted(rest, fit, fit.filter)) for fit in fits]


def test_fewer_poles_than_the_best():
    one, two = one_pole_fits(1, 2)
    choice = Choice(two, [two, one])
    fewer = of_fewer_poles(choice)
    assert fewer is not None and fewer.best is one and fewer.all == choice.all
    assert of_fewer_poles(fewer) is None


def test_in_pieces_a_small_structure_with_a_hidden_mode_is_not_taken(monkeypatch):
    """Of two, three and four poles the first is the likeliest by name, and hides a mode."""
    found = one_pole_fits(2, 3, 4)
    hides = {2}
    monkeypatch.setattr(
        order_search,
        "hidden_modes",
        lambda fit: np.ones(int(len(fit.model.denominator) in hides)),
    )
    assert order_search._smallest(found) is found[0]

    def without_a_row(fit):
        kept = np.arange(len(fit.rows)) != 500
        names = ("rows", "errors", "jacobian")
        return replace(fit, **{name: getattr(fit, name)[kept] for name in names})

    cut = [replace(one, fit=without_a_row(one.fit)) for one in found]
    assert order_search._smallest(cut) is cut[1]
    hides |= {3, 4}
    assert order_search._smallest(cut) is cut[0]

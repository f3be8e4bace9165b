"""Yuan's chapter 4: computations against reference numbers, verdicts against made-up results."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.papers.verdicts import Verdict
from experiments.papers.yuan_bounded import experiment as paper
from experiments.papers.yuan_bounded.claims import claims, errors
from tests.reference_data import numbers_of

ORDER = Verdict.SAME_ORDERING
YES, PARTLY, NO = Verdict.REPRODUCED, Verdict.IN_PART, Verdict.NOT_REPRODUCED


@pytest.fixture(scope="module")
def numbers():
    return numbers_of("guarantees/axis")


def test_the_axis_is_that_of_the_reference(numbers):
    np.testing.assert_allclose(paper.axis().A, numbers["A"], atol=1e-12)
    np.testing.assert_allclose(np.asarray(paper.axis().B)[:, 0], numbers["B"], atol=1e-15)
    unknown = paper.disturbed(5e-3, previewed=False).E
    np.testing.assert_allclose(unknown, np.stack([numbers["E"], numbers["G"]], axis=1), atol=1e-15)
    bounds = paper.limits(previewed=False)
    assert float(bounds.control) == pytest.approx(numbers["bounds"]["u_tilde"], rel=1e-9)
    assert bounds.signals[0].limit == pytest.approx(numbers["bounds"]["v_error"])


def test_forty_samples_are_too_few_against_an_unknown_reference(numbers):
    assert paper.least_tolerance(paper.UNKNOWN, 40) == np.inf
    wanted = [case for case in numbers["cases"] if case["N"] == 40 and case["previewed"]]
    assert paper.least_tolerance(paper.PREVIEWED, 40) == pytest.approx(
        1e3 * wanted[0]["least_tolerance_m"], rel=1e-4
    )


@pytest.mark.slow
def test_the_certificate_is_the_reference():
    wanted = numbers_of("guarantees/single_axis")["eps_min_m"]
    for (size, speed), value in zip(((0.005, 0.1), (0.0025, 0.1)), wanted.values(), strict=False):
        row = paper.certificate(size, speed)
        assert row == pytest.approx(1e3 * value, rel=1e-6)


def made_up():
    """A printed set that is empty, tolerances below 4.5 mm, loops within what they promise."""
    error = np.array([0.5, -1.0])
    loops = (
        paper.LoopRow(paper.UNKNOWN, 1.4, 1.0, 8.6, 0.1, 0.15, 2, error),
        paper.LoopRow(paper.PREVIEWED, 0.09, 0.08, 9.0, 0.2, 0.25, 2, error / 20),
    )
    least = {paper.UNKNOWN: 1.39, paper.PREVIEWED: 0.058}
    runs = (("1 kHz", 3.9, 1.7), ("4 kHz", 3.8, 1.7), ("standard", 7.7, 5.3), ("tuned", 2.2, 1.4))
    motions = tuple(
        paper.PointToPointRun(name, 1e-3, most, mean, error) for name, most, mean in runs
    )
    return paper.Result(1.001, 4.856, least, loops, motions, paper.algorithm_1())


def test_verdicts_follow_the_numbers():
    def verdicts(result):
        return [claim.verdict for claim in claims(result)]

    whole = made_up()
    assert verdicts(whole)[:5] == [NO, NO, PARTLY, PARTLY, PARTLY]
    assert verdicts(whole)[5:] == [YES, NO, NO, ORDER, YES, NO, Verdict.EXPERIMENTAL, PARTLY]
    assert verdicts(replace(whole, invariant=None))[-1] == NO
    one, *others = whole.motions
    printed = replace(one, largest_mm=3.44, mean_mm=0.66)
    assert verdicts(replace(whole, motions=(printed, *others)))[6:9] == [YES, NO, NO]
    printed = tuple(replace(row, speed_limit=0.1) for row in whole.loops)
    assert verdicts(replace(whole, loops=printed))[3] == YES
    assert verdicts(replace(whole, observer_radius=0.99))[0] == YES
    assert verdicts(replace(whole, bound_mm=4.4))[1] == YES
    wide = {paper.UNKNOWN: 1.39, paper.PREVIEWED: 5.0}
    assert verdicts(replace(whole, least_mm=wide))[2] == NO
    out = (whole.loops[0], replace(whole.loops[1], largest_mm=0.1))
    assert verdicts(replace(whole, loops=out))[3] == NO
    strong = (replace(whole.loops[0], largest_current=9.1), whole.loops[1])
    assert verdicts(replace(whole, loops=strong))[4] == NO


def test_the_figure_shows_the_numbers():
    panel = errors(made_up()).axes[1]
    assert panel.lines[0].get_ydata() == pytest.approx([0.025, -0.05])
    assert {abs(line.get_ydata()[0]) for line in panel.lines[1:]} == {0.09}


@pytest.mark.slow
def test_the_chapter_in_its_quick_form():
    result = paper.run(quick=True)
    verdicts = [claim.verdict for claim in claims(result)]
    assert verdicts[:5] == [NO, NO, PARTLY, PARTLY, PARTLY]
    assert all(0.5 * row.promised_mm < row.largest_mm <= row.promised_mm for row in result.loops)


def test_the_motion_waits_and_ends_after_a_tenth_of_a_metre():
    position = np.asarray(paper.motion(1e-3, 1).position)[:, 0]
    assert not position[:200].any() and position[-1] == pytest.approx(0.1)
    assert np.diff(position).max() == pytest.approx(1e-4)
    assert np.diff(position, 2).max() == pytest.approx(4e-6, rel=1e-6)

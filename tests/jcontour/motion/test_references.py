import jax
import numpy as np
import pytest

from jcontour.geometry.contours import circle, lemniscate, line, polyline
from jcontour.motion.references import along, from_samples, in_time, pad
from jcontour.simulation.metrics import contour_error, projected_error

DT = 1e-3


def around(step, count):
    angle = step * np.arange(count)
    return 1e-3 * np.stack([np.cos(angle), np.sin(angle)], -1), np.stack(
        [-np.sin(angle), np.cos(angle)], -1
    )


def test_preview_of_a_run_to_rest_holds_the_last_sample():
    reference = along(line([0, 0], [3e-3, 4e-3]), [0.0, 1e-3, 5e-3], DT, 4, at_rest=True)
    assert (reference.steps, reference.preview) == (3, 4)
    position = np.asarray(reference.position)
    np.testing.assert_allclose(position[2:], np.tile([3e-3, 4e-3], (5, 1)), atol=1e-18)
    np.testing.assert_array_equal(reference.start_increment, [0, 0])
    np.testing.assert_array_equal(reference.mask, [True] * 3 + [False] * 4)


def test_preview_around_a_closed_contour_wraps():
    arc = np.linspace(0, 2e-3 * np.pi, 17)
    reference = along(circle(1e-3), arc, DT, 3, at_rest=False)
    position, tangent = around(2 * np.pi / 16, 20)
    np.testing.assert_allclose(reference.position, position, atol=1e-15)
    np.testing.assert_allclose(reference.tangent, tangent, atol=1e-12)
    np.testing.assert_allclose(reference.start_increment, position[1] - position[0], atol=1e-15)


def test_preview_beyond_an_open_contour_goes_straight_on_at_the_last_increment():
    reference = along(
        polyline([[0, 0], [0, 1e-3], [1e-3, 1e-3]]),
        [0.0, 1.0e-3, 1.8e-3, 2.0e-3],
        DT,
        3,
        at_rest=False,
    )
    beyond = np.asarray(reference.position)[4:]
    np.testing.assert_allclose(beyond, [[1.2e-3, 1e-3], [1.4e-3, 1e-3], [1.6e-3, 1e-3]], atol=1e-15)
    np.testing.assert_allclose(np.asarray(reference.tangent)[4:], [[1, 0]] * 3)
    np.testing.assert_allclose(reference.start_increment, [0, 1e-3], atol=1e-15)


def test_scored_samples_make_the_mask():
    scored = [True, False, True]
    reference = along(
        line([0, 0], [1e-2, 0]), [0.0, 1e-3, 2e-3], DT, 2, at_rest=False, scored=scored
    )
    np.testing.assert_array_equal(reference.mask, [*scored, False, False])


def test_samples_become_a_reference_with_their_polyline():
    position, tangent = around(0.3, 9)
    reference = from_samples(position, tangent, DT, 3)
    assert (reference.steps, reference.preview) == (6, 3)
    np.testing.assert_array_equal(reference.mask, [True] * 6 + [False] * 3)
    np.testing.assert_allclose(reference.start_increment, position[1] - position[0])
    np.testing.assert_allclose(reference.contour.position(reference.arc), position, atol=1e-15)
    np.testing.assert_array_equal(
        from_samples(position, tangent, DT, 3, in_motion=False).start_increment, [0, 0]
    )


@pytest.mark.parametrize(
    "contour",
    [circle(1e-3), polyline([[0, 0], [1e-3, 0], [1e-3, 1e-3], [-1e-3, 1e-3]]), lemniscate(3e-3)],
    ids=["circle", "corners", "self-crossing"],
)
def test_samples_of_a_contour_keep_their_place_on_it(contour):
    """Otherwise the contour error is measured from the wrong place.

    It would come out larger than the tracking error.
    """
    arc = 3.7e-2 * float(contour.length) * np.arange(25)
    position, tangent = np.asarray(contour.position(arc)), np.asarray(contour.tangent(arc))
    reference = from_samples(position, tangent, DT, 2, contour)
    np.testing.assert_allclose(contour.position(reference.arc), position, rtol=0, atol=1e-12)


def double_lap():
    """A square run twice; the second lap ends with a line that leaves it."""
    lap = 1e-3 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return polyline([*lap, *lap, [0, 0], [-1e-3, 0]])


@pytest.mark.parametrize(("first", "last"), [(2e-3, 8.9e-3), (0.3e-3, 7e-3), (4.3e-3, 8.8e-3)])
def test_samples_run_on_the_lap_that_fits_their_whole_run(first, last):
    """Both laps fit the first sample, and only one of them the others."""
    contour, arc = double_lap(), np.arange(first, last, 50e-6)
    position, tangent = np.asarray(contour.position(arc)), np.asarray(contour.tangent(arc))
    np.testing.assert_allclose(from_samples(position, tangent, DT, 2, contour).arc, arc, atol=1e-12)


def test_samples_that_fit_every_lap_run_on_the_first():
    contour, arc = double_lap(), np.arange(0.3e-3, 2e-3, 50e-6)
    position, tangent = np.asarray(contour.position(arc + 4e-3)), contour.tangent(arc)
    np.testing.assert_allclose(from_samples(position, tangent, DT, 2, contour).arc, arc, atol=1e-12)


def test_samples_run_there_or_back_as_their_tangents_say():
    contour = polyline([[0, 0], [1e-3, 0], [0, 0]])
    for arc in (np.linspace(0.2e-3, 0.8e-3, 30), np.linspace(1.2e-3, 1.8e-3, 30)):
        position, tangent = np.asarray(contour.position(arc)), np.asarray(contour.tangent(arc))
        reference = from_samples(position, tangent, DT, 2, contour)
        np.testing.assert_allclose(reference.arc, arc, atol=1e-12)


def test_a_crossing_is_left_as_the_tangent_says():
    contour = lemniscate(3e-3)
    half = 0.5 * float(contour.length)
    for start in (0.0, half):  # where the curve crosses itself
        arc = start + np.arange(20) * 1e-5
        position, tangent = np.asarray(contour.position(arc)), np.asarray(contour.tangent(arc))
        reference = from_samples(position, tangent, DT, 2, contour)
        np.testing.assert_allclose(reference.arc, arc, atol=1e-9)


def test_samples_off_their_contour_are_refused():
    position, tangent = around(0.1, 20)
    size = float(circle(1e-3).size)
    with pytest.raises(ValueError, match=r"position: sample \d+ is 0.9.* m from the contour"):
        from_samples(1e3 * position, tangent, DT, 2, circle(1e-3))
    off = position * (1 + 5e-5)
    from_samples(off, tangent, DT, 2, circle(1e-3))
    with pytest.raises(ValueError, match="the tolerance is 4e-08 m"):
        from_samples(off, tangent, DT, 2, circle(1e-3), tolerance=4e-8)
    far = position * (1 + 0.02 * size / 1e-3)
    with pytest.raises(ValueError, match="from the contour"):
        from_samples(far, tangent, DT, 2, circle(1e-3))
    from_samples(far, tangent, DT, 2, circle(1e-3), tolerance=1e-3)
    with pytest.raises(ValueError, match="tolerance: needs a distance"):
        from_samples(off, tangent, DT, 2, circle(1e-3), tolerance=np.nan)


def test_preview_samples_may_lie_beyond_an_open_contour():
    arc = np.linspace(0.0, 2e-3, 21)
    position = np.stack([arc, 0 * arc], axis=1)
    tangent = np.tile([1.0, 0.0], (21, 1))
    contour = line([0, 0], [1e-3, 0])
    reference = from_samples(position, tangent, DT, 10, contour)
    np.testing.assert_allclose(np.asarray(reference.arc)[:11], arc[:11])
    with pytest.raises(ValueError, match="sample 11"):
        from_samples(position, tangent, DT, 9, contour)


def test_padding_holds_the_end_and_is_not_scored():
    reference = along(circle(1e-3), 1e-4 * np.arange(5), DT, 2, at_rest=False)
    padded = pad(reference, 8)
    assert (padded.steps, padded.preview) == (8, 2)
    position, kept = np.asarray(padded.position), np.asarray(reference.position)
    np.testing.assert_array_equal(position[:7], kept)
    np.testing.assert_array_equal(position[7:], np.tile(kept[-1], (3, 1)))
    np.testing.assert_array_equal(padded.mask, [True] * 5 + [False] * 5)
    with pytest.raises(ValueError, match="5 control steps, more than the 4"):
        pad(reference, 4)


CHECKED = "Type-check error"  # what a checker of annotations says
GOOD = {"position": [[0, 0], [1e-3, 0], [2e-3, 0]], "tangent": [[1, 0]] * 3, "dt": DT, "preview": 1}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": [[0, 0], [1e-3, 0]]}, r"same shape.*\(2, 2\) and \(3, 2\)"),
        ({"position": [0, 1, 2], "tangent": [1, 1, 1]}, r"same shape \(S, m\), m from 1 to 3"),
        ({"position": [[0, 0], [np.nan, 0], [1, 0]]}, "position: every entry needs to be finite"),
        ({"tangent": [[1, 0], [np.inf, 0], [1, 0]]}, "tangent: every entry needs to be finite"),
        ({"tangent": [[1, 0], [1, 0.1], [1, 0]]}, "tangent: needs unit vectors"),
        ({"dt": 0.0}, "dt"),
        ({"preview": 3}, "preview: 3 samples leave no control step"),
        ({"preview": -1}, "preview"),
        ({"position": [[0, 0]] * 3}, "2 distinct points"),
    ],
)
def test_bad_samples_are_named(change, words):
    with pytest.raises(ValueError, match=words):
        from_samples(**{**GOOD, **change})


@pytest.mark.parametrize(
    "change",
    [
        {"position": [[0, 0]], "tangent": [[1, 0]], "preview": 0},
        {"position": np.eye(3), "tangent": np.eye(3)},
    ],
    ids=["one sample", "axes"],
)
def test_samples_that_do_not_fit_the_contour_are_named(change):
    with pytest.raises(ValueError):
        from_samples(**{**GOOD, **change}, contour=line([0, 0], [1, 0]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"arc": [0.0]}, "at least two samples"),
        ({"arc": [[0.0, 1.0]]}, "arc: needs shape"),
        ({"arc": [0.0, np.nan]}, "arc: every entry needs to be finite"),
        ({"arc": [2e-4, 3e-4, 1e-4]}, "arc: may not go back, as it does after sample 1 by 0.0002"),
        ({"preview": -1}, "preview"),
        ({"dt": -1.0}, "dt"),
        ({"scored": [True] * 3}, "shape"),
        ({"scored": [False]}, "shape"),
    ],
)
def test_bad_feed_is_named(change, words):
    good = {
        "contour": line([0, 0], [1e-3, 0]),
        "arc": [0.0, 1e-4],
        "dt": DT,
        "preview": 2,
        "at_rest": False,
    }
    with pytest.raises(ValueError, match=words):
        along(**{**good, **change})


def test_a_law_of_time_is_exact_in_the_preview_too():
    reference = in_time(circle(1e-3), lambda t: 0.1 * t**2, 10 * DT, DT, preview=3, dwell=4 * DT)
    arc = 0.1 * np.clip(np.arange(14) * DT - 4 * DT, 0, None) ** 2
    np.testing.assert_allclose(reference.arc, arc, atol=1e-18)
    np.testing.assert_allclose(
        reference.position,
        1e-3 * np.stack([np.cos(arc / 1e-3), np.sin(arc / 1e-3)], -1),
        atol=1e-15,
    )
    assert (reference.steps, reference.preview) == (11, 3)
    np.testing.assert_array_equal(reference.start_increment, [0, 0])


@pytest.mark.parametrize(
    ("duration", "dwell", "name"),
    [(0.01, -1e-3, "dwell"), (0.0105, 0.0, "duration"), (0.01, 0.02, "dwell")],
)
def test_bad_times_are_named(duration, dwell, name):
    with pytest.raises(ValueError, match=f"^{name}: "):
        in_time(circle(1e-3), lambda t: t, duration, DT, dwell=dwell)


def test_one_axis_has_a_contour_error_only_beyond_its_travel():
    """There and back: late by 1 mm costs nothing, 1 mm past the turn does."""
    position = 0.01 * np.sin(np.linspace(0, np.pi, 41))[:, None]
    tangent = np.sign(np.gradient(position, axis=0) + 1e-12)
    reference = from_samples(position, tangent, DT, 1, in_motion=False)
    assert reference.position.shape == (41, 1) and reference.contour.axes == 1
    output = np.asarray(reference.position[:40]) - 1e-3 * tangent[:40]
    output[20] = 0.011
    error = np.abs(np.asarray(contour_error(output, reference)))[:, 0]
    np.testing.assert_allclose(error[20], 1e-3, rtol=1e-9)
    np.testing.assert_allclose(error[[3, 10, 30, 36]], 0.0, atol=1e-15)
    np.testing.assert_allclose(projected_error(output, reference), 0.0, atol=1e-15)


def test_the_first_steps_are_those_of_the_shorter_run():
    whole = along(circle(1e-2), 1e-4 * np.arange(9), 1e-3, 3, at_rest=False)
    wanted = along(circle(1e-2), 1e-4 * np.arange(5), 1e-3, 3, at_rest=False)
    actual = whole.first(5)
    assert (actual.steps, actual.preview) == (5, 3) and actual.contour is whole.contour
    for name in ("position", "tangent", "arc"):
        np.testing.assert_allclose(getattr(actual, name), getattr(wanted, name), atol=1e-15)


@pytest.mark.parametrize("preview", [1.5, -1, float("nan")])
def test_a_preview_is_a_whole_number_of_samples(preview):
    path = circle(1e-3)
    for make in (
        lambda: from_samples(**{**GOOD, "preview": preview}),
        lambda: along(path, [0.0, 1e-4], DT, preview, at_rest=False),
        lambda: in_time(path, lambda t: t, 0.01, DT, preview),
    ):
        words = f"preview: needs a whole number of at least 0, received {preview}"
        with pytest.raises((ValueError, TypeError), match=f"{words}|{CHECKED}"):
            make()


@pytest.mark.parametrize("steps", [0, -3, 10, 2.5, float("nan")])
def test_more_or_fewer_steps_than_a_run_has_are_refused(steps):
    whole = along(circle(1e-2), 1e-4 * np.arange(9), 1e-3, 3, at_rest=False)
    with pytest.raises(
        (ValueError, TypeError), match=f"steps: the run has 9 .* first {steps}|{CHECKED}"
    ):
        whole.first(steps)


def test_samples_beside_a_corner_have_the_arc_length_of_the_path():
    """Steps of 0.1 mm that cut corners of 1 mm sides in their middle: the chord is shorter."""
    path = polyline([[0, 0], [1e-3, 0], [1e-3, 1e-3], [2e-3, 1e-3]])
    arc = 5e-5 + 1e-4 * np.arange(29)
    x = np.where(arc < 1e-3, arc, np.maximum(1e-3, arc - 1e-3))
    position = np.stack([x, np.clip(arc - 1e-3, 0, 1e-3)], axis=1)
    along_y = (arc > 1e-3) & (arc < 2e-3)
    tangent = np.where(along_y[:, None], [[0.0, 1.0]], [[1.0, 0.0]])
    reference = from_samples(position, tangent, DT, preview=2, contour=path)
    np.testing.assert_allclose(reference.arc, arc, atol=1e-15)


def test_a_run_aside_keeps_its_last_offset_and_its_contour():
    reference = along(line([0, 0], [1e-3, 0]), np.linspace(0, 1e-3, 5), DT, 3, at_rest=True)
    offset = 1e-6 * np.arange(10.0).reshape(5, 2)
    tangent = np.tile([0.0, 1.0], (5, 1))
    beside = reference.aside(offset, tangent)
    moved = np.asarray(beside.position) - np.asarray(reference.position)
    np.testing.assert_allclose(moved[:5], offset, atol=1e-18)
    np.testing.assert_allclose(moved[5:], np.tile(offset[-1], (3, 1)), atol=1e-18)
    turned = np.asarray(beside.tangent)
    np.testing.assert_array_equal(turned[:5], tangent)
    np.testing.assert_array_equal(turned[5:], np.asarray(reference.tangent)[5:])
    error = jax.jit(contour_error)(np.asarray(beside.position)[:5], beside)
    np.testing.assert_allclose(np.asarray(error)[1:, 1], offset[1:, 1])

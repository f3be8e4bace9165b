"""Verdicts and printed digits."""

import pytest

from experiments.papers.verdicts import Claim, Verdict, missed, rounds_to, tally, undecided, verdict


@pytest.mark.parametrize(
    ("value", "printed", "same"),
    [
        (1.1705, "1.171", True),
        (1.1704, "1.171", False),
        (0.0025145, "2.515e-3", True),
        (0.00251449, "2.515e-3", False),
        (-11.30996, "-11.3100", True),
        (-11.3099, "-11.3100", False),
        (816.6, "817", True),
        (0.0, "0.00", True),
        (float("nan"), "1.0", False),
        (float("inf"), "1.0", False),
    ],
)
def test_rounding_to_the_print(value, printed, same):
    assert rounds_to(value, printed) is same


@pytest.mark.parametrize("printed", ["", "lost", "1.0e"])
def test_what_is_no_number_is_refused(printed):
    with pytest.raises(ValueError, match=r"invalid literal|could not convert|printed"):
        rounds_to(1.0, printed)


def test_a_verdict_holds_in_full_in_part_or_not():
    assert verdict(True) is verdict(True, partly=True) is Verdict.REPRODUCED
    assert verdict(False, partly=True) is Verdict.IN_PART
    assert verdict(False) is Verdict.NOT_REPRODUCED


def test_a_quick_run_takes_the_verdicts_back():
    rows = (Claim("1", "a", "b", Verdict.REPRODUCED), Claim("2", "c", "d", Verdict.EXPERIMENTAL))
    found = undecided(rows)
    assert {row.verdict for row in found} == {Verdict.UNDECIDED}
    assert [row.claim for row in found] == ["a", "c"]
    assert tally(rows) == (
        "Verdicts on 2 statements: 1 reproduced; 1 experimental: shown, not matched."
    )


def test_what_is_missed_ends_in_a_line_each_the_worst_first():
    rows = (
        Claim("1", "a", "b", Verdict.REPRODUCED),
        Claim("Table 2", "20 numbers", "12 of 20", Verdict.IN_PART),
        Claim("Fig. 3", "it falls", "it rises", Verdict.NOT_REPRODUCED),
    )
    assert missed(rows)[1:] == [
        "  not reproduced: Fig. 3: it falls: here it rises",
        "  in part: Table 2: 20 numbers: here 12 of 20",
    ]
    assert missed(rows[:1]) == []

"""The default of every number of a row that failed is none."""

from jcontour.app.files.results.ranked_result import Candidate, Ranked
from jcontour.app.files.results.stored import to_json


def test_a_failed_row_is_stored_without_numbers():
    candidate = Candidate(controller="lq", preview=5, terminal="output")
    written = to_json(Ranked(candidate=candidate, label="lq", failure="why"))
    assert set(written) == {"candidate", "label", "failure"}

"""The application: the `jcontour` command, its machines, jobs, results, tables and page."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jcontour.app.files.results.loop_results import SimulatedResult
    from jcontour.app.files.results.search_results import FrontResult
    from jcontour.app.files.results.tuned_result import TunedResult


def result(folder: str | Path) -> "TunedResult | SimulatedResult | FrontResult":
    """Result of a run of `tune`, `simulate` or `front`; a notebook shows the command's screen.

    >>> jcontour.app.result("runs/tune-1")  # doctest: +SKIP

    Raises:
        RunError: it is no folder of such a run, or one of another version.
    """
    from jcontour.app.reports.page.page_data import stored_result

    return stored_result(Path(folder))

"""Flags of the commands about stored runs, papers and the library itself."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from jcontour.app.flags.shared import Common

Drive = Literal["general", "linuxcnc-pid", "siemens", "beckhoff", "odrive"]


@dataclass(frozen=True)
class Report(Common):
    """Write one page of stored runs for a browser, and compare runs of one command.

    The page has everything inside and loads nothing. Of several runs of `tune`, or of `simulate`
    and `audit`, it says what differs, and which has the least of every number.
    """

    runs: Positional[tuple[Path, ...]] = ()
    """Run folders of `jcontour tune`, `simulate`, `audit` or `front`."""
    page: bool = True
    """The page; --no-page leaves the comparison and the gains alone."""
    drive: Drive | None = None
    """Gains of the nearest simple loop of a tuned run, in the parameters of a product."""
    out: Path | None = None
    """Folder for report.html, or the page itself where the name ends in .html.
    The first run's folder when not given."""


@dataclass(frozen=True)
class Listing(Common):
    """List the plants, controllers, contours and experiments that have names."""


@dataclass(frozen=True)
class Reproduce(Common):
    """Reproduce a paper.

    `jcontour list` shows the names, `jcontour reproduce NAME --help` the flags of one.
    """

    name: Positional[str] = ""
    """Name of the experiment."""


@dataclass(frozen=True)
class Bench(Common):
    """Time the library on this computer.

    Times are ratios against something run beside it; hardware and versions are named.
    """

    what: Positional[
        Literal[
            "mpc",
            "qp",
            "lq",
            "gantry",
            "tuners",
            "whole_way",
            "public",
        ]
    ] = "mpc"  # it has to fit a sample period
    """Timed part of the library.
    mpc: one step of the constrained controllers, by part and by solver.
    qp: many problems of constrained control at once, with their slopes.
    lq: whole runs of the LQ contouring controller.
    gantry: the gantry in every engine.
    tuners: the tuner against searches without slopes, hours; `uv run --group bench`.
    whole_way: from the log of a hidden machine to the contour error there, minutes each.
    public: predictions for public records of real machines, and the page about them."""
    batch: tuple[int, ...] = ()
    """LQ: runs at once, what suits the device when not given.
    Gantry: machines at once, 1000 when not given.
    QP: problems at once, 128 when not given."""
    seeds: int = 20  # quartiles of fewer say little
    """Tuners: random starts of every search. Whole_way: machines of two axes."""
    first_seed: int = 0
    """Whole_way: seed of the first machine."""
    searches: tuple[str, ...] = ()
    """Tuners: names of those that search, as the table has them; all when not given."""
    evaluations: int = 600  # CMA-ES needs hundreds at four weights
    """Tuners: evaluations of every search; one with slopes counts three.
    Whole_way: of every search at most, one with slopes counts one."""
    keep: Path | None = None
    """File that keeps what is done; with it, a second run goes on.
    Tuners: every start; whole_way: every machine.
    LQ, QP: results that later ones are compared with."""
    records: Path | None = None
    """Public: folder with the records, a folder each."""

"""`report` from the command line."""

import json

import pytest

from jcontour.app.cli import main
from jcontour.app.commands.report import page_at
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.tuned_result import DriveLoop
from jcontour.app.files.run_folder import RunError
from jcontour.app.reports.page.page_data import FILE
from tests.app import small_runs


def test_faults_are_told_in_a_line(tmp_path, capsys):
    assert main(["report"]) == 2
    assert "report: needs a run folder" in capsys.readouterr().err
    assert main(["report", str(tmp_path)]) == 2
    assert "is not a run folder" in capsys.readouterr().err
    (tmp_path / "settings.json").write_text('{"command": "check", "flags": {}}')
    assert main(["report", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "pages are made of tune, simulate, audit, front" in told
    assert not list(tmp_path.glob("*.html"))


def test_out_is_a_folder_or_a_page_by_its_suffix(tmp_path):
    assert page_at(tmp_path / "new") == tmp_path / "new" / "report.html"
    assert page_at(tmp_path) == tmp_path / "report.html"
    assert page_at(tmp_path / "r" / "mine.HTML") == tmp_path / "r" / "mine.HTML"
    (tmp_path / "odd.html").mkdir()
    assert page_at(tmp_path / "odd.html").parent.name == "odd.html"
    (tmp_path / "taken").touch()
    with pytest.raises(RunError, match="taken: is a file; give a folder"):
        page_at(tmp_path / "taken")


def test_a_run_has_its_page_beside_it_and_two_runs_share_one(tour, tmp_path, capsys):
    runs = [tour(name).folder for name in ("simulate", "tune")]
    for run in runs:
        assert (run / FILE).stat().st_size < 1_000_000
    out = tmp_path / "both.html"
    assert main(["report", *map(str, runs), "--json", "--out", str(out)]) == 0
    written = {"page": str(out), "bytes": out.stat().st_size}
    assert json.loads(capsys.readouterr().out) == written
    assert main(["report", str(runs[0]), "--no-page"]) == 2
    assert "needs two runs of tune" in capsys.readouterr().err
    assert '"name":"simulate"' in out.read_text() and '"name":"tune"' in out.read_text()
    assert main(["report", str(runs[0]), "--out", str(tmp_path / "new" / "folder")]) == 0
    assert (tmp_path / "new" / "folder" / FILE).read_text().startswith("<!")


def test_the_gains_of_a_drive_are_printed_in_the_parameters_of_a_product(tmp_path, capsys):
    loop = DriveLoop(
        controller="p", weights={"position": 20.0}, error=3e-6, tuned_error=1e-6, kept=True
    )
    (tmp_path / "settings.json").write_text('{"command": "tune"}')
    write_result(tmp_path, small_runs.tuned_result(drive=loop))
    asked = ["report", str(tmp_path), "--no-page", "--drive"]
    assert main([*asked, "siemens"]) == 0
    assert "MD32200 POSCTRL_GAIN 1.2 1000/min" in capsys.readouterr().out
    write_result(tmp_path, small_runs.tuned_result())
    assert main([*asked, "siemens"]) == 2
    assert "a run of tune that tried a simple loop" in capsys.readouterr().err

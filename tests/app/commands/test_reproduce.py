"""`reproduce` from the command line."""

import json

from jcontour.app.cli import main


def test_a_paper_ends_in_a_screen_and_tells_its_statements_in_detail(tmp_path, capsys):
    arguments = ["reproduce", "synchronisation", "--quick", "--details", "--out"]
    assert main([*arguments, str(tmp_path / "run")]) == 0
    printed = capsys.readouterr().out
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert "Statements" in printed
    assert f"{len(result['claims'])} statements" in printed
    assert (tmp_path / "run" / "figures-3-to-6.png").exists()

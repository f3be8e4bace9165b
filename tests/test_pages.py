"""The pages are true: examples run, links lead somewhere, commands and files exist."""

import re
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import pytest

from jcontour.app.cli import COMMANDS
from jcontour.app.commands.reproduce import experiments_found

ROOT = Path(__file__).parents[1]
SITE = "experiments/docs"
LIBRARY = f"{SITE}/how-to/use-the-library.md"
READMES = ["README.md"] + [
    path.relative_to(ROOT).as_posix()
    for folder in ("jcontour", "tuning", "experiments")
    for path in sorted((ROOT / folder).rglob("README.md"))
]
PAGES = READMES + [
    path.relative_to(ROOT).as_posix() for path in sorted((ROOT / SITE).rglob("*.md"))
]
FILES = [path.as_posix() for path in ROOT.rglob("*.py") if ".venv" not in path.parts]
OWN_TEST = ("README.md", LIBRARY)  # what their examples print is looked at, too
FIRST_PAGE, PAGE, PROSE = 8000, 4000, 50_000  # bytes of a page, and of the prose of them all
FLAGS = {name: kind for kind, (name, _) in COMMANDS.items()}
COMMAND = re.compile(r"\bjcontour ([a-z]+)([^&#\n]*)")
DATE = re.compile(r"\b20\d\d-\d\d-\d\d\b")
HASH = re.compile(r"\b(?=[a-f]*\d)(?=\d*[a-f])[0-9a-f]{7,40}\b")


def text_of(page):
    return (ROOT / page).read_text()


def python_blocks(page):
    return re.findall(r"```python\n(.*?)```", text_of(page), re.DOTALL)


def shell_code(page):
    """Shell blocks and what stands between backticks in the text."""
    blocks = re.findall(r"```sh\n(.*?)```", text_of(page), re.DOTALL)
    text = re.sub(r"```.*?```", "", text_of(page), flags=re.DOTALL)
    return "\n".join([*blocks, *re.findall(r"`([^`\n]+)`", text)])


def run_blocks(page):
    names = {}
    for block in python_blocks(page):
        exec(compile(block, page, "exec"), names)  # each goes on from those before


def test_the_own_controller_of_the_readme_runs(capsys):
    run_blocks("README.md")
    error, slope = re.fullmatch(
        r"([\d.]+) um; .* by (-?[\d.]+) um", capsys.readouterr().out.strip()
    ).groups()
    assert 10 < float(error) < 30  # a velocity lag of 0.05 m/s, half of it fed forward
    assert -2 < float(slope) < 0  # more feedforward lowers it


@pytest.mark.slow
def test_the_examples_of_the_library_guide_run(capsys):
    run_blocks(LIBRARY)
    lines = capsys.readouterr().out.splitlines()
    ahead = [line.split() for line in lines if " ahead: " in line]
    for words in ahead:  # |b|^(N_p - 1): Alter & Tsao, eq. 8
        wanted = 0.3075 ** (int(words[0]) - 1)
        assert [float(words[3]), float(words[8])] == pytest.approx([wanted] * 2, rel=5e-3)
    assert len(ahead) == 4
    laps = [float(line.split()[2]) for line in lines if line.startswith("lap ")]
    assert len(laps) == 5 and laps == sorted(laps, reverse=True) and laps[4] < 0.02 * laps[0]
    (bounded,) = [line.split() for line in lines if line.startswith("proven ")]
    assert 0.99 * float(bounded[1]) < float(bounded[4]) <= float(bounded[1])
    lines = [line for line in lines if not line.startswith("proven ")]
    (remembered,) = [line.split() for line in lines if " remembered, " in line]
    assert remembered[0] == "8" and int(remembered[3]) > 300
    lines = [line for line in lines if " remembered, " not in line]
    lines = [line for line in lines if not line.startswith("lap ")]
    *printed, traced = (line for line in lines if " ahead: " not in line)
    numbers = [float(line.split()[-2]) for line in printed]
    errors, deformations = numbers[:3], numbers[3:]
    assert errors == sorted(errors, reverse=True)  # more contour weight, less contour error
    assert deformations[:2] == [0.566, 0.542]  # the reference's runs, mm
    assert len(deformations) == 4 and deformations[3] < 0.6 * deformations[0]
    found = re.fullmatch(r"([\d.]+) s, ([\d.]+) um, worst residual ([\de.-]+)", traced)
    time, rms, residual = map(float, found.groups())
    assert 1.6 < time < 1.7 and 20 < rms < 40  # the reference's run: 1.645 s, 28.4 um at 1 ms
    assert residual <= 1e-8


@pytest.mark.parametrize("page", READMES)
def test_readmes_are_short(page):
    assert len((ROOT / page).read_bytes()) <= (FIRST_PAGE if page == "README.md" else PAGE)


def test_all_prose_is_short():
    """Tables, code and what is made from docstrings or results do not count."""
    made = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
    lines = [line for page in PAGES for line in made.sub("", text_of(page)).splitlines()]
    prose = [line for line in lines if not line.startswith(("|", ":::", "    ", "<!--"))]
    assert sum(len(line.encode()) for line in prose) <= PROSE


@pytest.mark.parametrize("page", PAGES)
def test_pages_have_no_history(page):
    """A page tells how things are: neither when they were measured nor by which commit."""
    text = re.sub(r"```.*?```", "", text_of(page), flags=re.DOTALL)
    assert not DATE.findall(text) + HASH.findall(text)


OTHERS = [page for page in PAGES if page not in OWN_TEST and python_blocks(page)]


@pytest.mark.parametrize("page", OTHERS)
def test_other_examples_run(page):
    run_blocks(page)


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    """Files, folders and pictures that a page links to exist, and so do the headings."""
    for target in re.findall(r"(?:\]\(|src=\")([^)\s\"]+)[)\"]", text_of(page)):
        if target.startswith(("http://", "https://")):
            continue
        file, _, heading = target.partition("#")
        linked = (ROOT / page).parent / file if file else ROOT / page
        assert linked.exists(), f"{page} links to {target}"
        if page.startswith(SITE):  # a folder of its own, without the files around it
            assert linked.resolve().is_relative_to(ROOT / SITE), f"{page} links to {target}"
        if heading:
            assert heading in anchors(linked.read_text()), f"{page} links to {target}"


def anchors(text):
    """Names that a heading is linked by: lower case, without punctuation, hyphens for blanks."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES)
def test_files_and_modules_exist(page):
    """Python files that a page names, and modules that it takes docstrings from."""
    for name in re.findall(r"`([\w/-]+\.py)`", text_of(page)):
        if name in ("mine.py", "law.py") or "NAME" in name:  # the reader's, or written for him
            continue
        assert any(file.endswith(f"/{name}") for file in FILES), f"{page}: there is no {name}"
    for module in re.findall(r"^::: ([\w.]+)$", text_of(page), re.MULTILINE):
        import_module(module)


@pytest.mark.parametrize("page", PAGES)
def test_commands_exist(page):
    """Commands that a page names, with their flags, and the papers to reproduce."""
    for name, arguments in COMMAND.findall(shell_code(page)):
        assert name in FLAGS, f"{page}: there is no jcontour {name}"
        words = arguments.split()
        if name == "reproduce":
            papers = [word for word in words if re.fullmatch(r"[a-z][a-z-]+", word)][:1]
            assert set(papers) <= set(experiments_found()), f"{page}: {arguments}"
            continue
        known = {field.name for field in fields(FLAGS[name])} | {"help"}
        flags = re.findall(r"--(?:no-)?([a-z][a-z-]*)", arguments)
        given = {flag.replace("-", "_") for flag in flags}
        assert given <= known, f"{page}: jcontour {name} has no flag {given - known}"


def test_the_commands_of_the_readme_are_all_of_them():
    table = re.findall(r"^\| `jcontour ([a-z]+)", text_of("README.md"), re.MULTILINE)
    assert sorted(table) == sorted(FLAGS)


def test_every_paper_has_its_parts_and_its_page():
    """The recipe of `contributing.md`."""
    parts = {
        "experiment": ("SOURCE", "run"),
        "claims": ("claims", "FIGURES"),
    }
    for name in experiments_found():
        folder = f"experiments.papers.{name.replace('-', '_')}"
        for module, names in parts.items():
            made = import_module(f"{folder}.{module}")
            assert all(hasattr(made, one) for one in names), f"{name}: {module}"
        assert (ROOT / SITE / f"evidence/{name}.md").exists(), name


def test_every_package_has_its_reference():
    """The pages of the API name every folder of the library."""
    named = {
        module
        for page in PAGES
        for module in re.findall(r"^::: ([\w.]+)$", text_of(page), re.MULTILINE)
    }
    internal = {"jcontour.app", "jcontour._native", "jcontour._kernels"}  # no library of their own
    folders = {f"jcontour.{path.parent.name}" for path in (ROOT / "jcontour").glob("*/__init__.py")}
    assert folders - internal <= named and {"tuning"} <= named

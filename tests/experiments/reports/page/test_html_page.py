"""The page's structure without a browser; what it does, in Chromium where there is one."""

import json
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser

import pytest

from experiments.files.run_folder import RunError
from experiments.reports.page import html_page
from experiments.reports.page.html_page import MOST_BYTES, write_page

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
VOID = {"meta", "input", "br", "link", "img"}


class Structure(HTMLParser):
    """Tags, ids and what is loaded from elsewhere."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.loaded, self.labelled = [], set(), [], 0

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.loaded += [named[key] for key in ("src", "href") if key in named]
        if "id" in named:
            assert named["id"] not in self.ids, named["id"]
            self.ids.add(named["id"])
        if tag in ("select", "input"):
            self.labelled += "label" in self.open
            assert "label" in self.open, f"{tag} {named} has no label"
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def page(run_folder):
    return write_page([run_folder], run_folder / "report.html")


def test_the_page_is_whole_and_loads_nothing(page):
    text = page.read_text()
    found = Structure()
    found.feed(text)
    assert found.open == [] and found.loaded == [] and found.labelled == 8
    assert {"part", "error", "control", "feed", "sensitivity", "front"} <= found.ids
    called = set(re.findall(r'\$\("([\w-]+)"\)', text))
    assert called <= found.ids, called - found.ids
    assert not re.search(r"https?://|@import|fetch\(|XMLHttpRequest", text)
    assert not re.search(r"@[A-Z]+@", text)


def test_text_of_the_user_is_no_markup(page, nasty):
    text = page.read_text()
    assert nasty not in text and "<img" not in text and "innerHTML" not in text
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert data is not None
    (run,) = json.loads(data[1])
    assert run["machine"] == nasty and run["verdict"]["reasons"] == [nasty]


def test_too_large_a_page_is_told(run_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(html_page, "MOST_BYTES", 1000)
    with pytest.raises(RunError, match="give fewer runs"):
        write_page([run_folder], tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()


needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")

TRIAL = """
<script>
const picture = (id) => document.getElementById(id).toDataURL();
const set = (id, value, kind) => { $(id).value = value; $(id).dispatchEvent(new Event(kind)); };
function timed(act) {
  const began = performance.now();
  act();
  drawNow();
  return performance.now() - began;
}
function trial() {
  const found = { ready: performance.now(), times: {} };
  const before = picture("part");
  found.times.factor = timed(() => set("factor", "80", "input"));
  found.slider = picture("part") !== before;
  const error = picture("error"), told = $("readout").textContent;
  found.times.cursor = timed(() => set("cursor", "1", "input"));
  found.linked = picture("error") !== error && $("readout").textContent !== told;
  const weights = $("point-weights").textContent, box = $("front").getBoundingClientRect();
  const plot = views.front, worst = plot.ys.indexOf(Math.max(...plot.ys));
  const clientX = box.x + plot.px(plot.xs[worst]), clientY = box.y + plot.py(plot.ys[worst]);
  const there = { clientX, clientY, bubbles: true };
  found.times.front = timed(() => $("front").dispatchEvent(new PointerEvent("pointerdown", there)));
  found.clicked = $("point-weights").textContent !== weights;
  found.times.contour = timed(() => set("contour", "1", "change"));
  found.times.family = timed(() => set("plant", "-1", "change"));
  found.times.along = timed(() => set("along", "arc", "change"));
  found.times.zoom = timed(() => set("zoom", "60", "input"));
  found.rows = $("readout").rows.length;
  found.scrolls = document.documentElement.scrollWidth > innerWidth;
  const answer = document.createElement("pre");
  answer.id = "answer";
  answer.textContent = JSON.stringify(found);
  document.body.append(answer);
}
trial();
</script>
"""


def tried(page, folder, size="1200,900"):
    """The page with the trial behind it, run in Chromium; its answer and console."""
    trial = folder / "trial.html"
    trial.write_text(page.read_text().replace("</body>", TRIAL + "</body>"))
    flags = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-logging=stderr",
        f"--window-size={size}",
        f"--user-data-dir={folder / 'profile'}",
        "--dump-dom",
        trial.as_uri(),
    ]
    done = subprocess.run([str(CHROMIUM), *flags], capture_output=True, text=True, timeout=120)
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    answer = re.search(r'<pre id="answer">(.*?)</pre>', done.stdout, re.DOTALL)
    assert answer is not None, done.stderr[-2000:]
    return json.loads(answer[1].replace("&amp;", "&")), said


@needs_chromium
@pytest.mark.slow
@pytest.mark.parametrize("size", ["1200,900", "500,800"], ids=["desk", "phone"])
def test_the_page_works_in_a_browser(page, tmp_path, size):
    found, said = tried(page, tmp_path, size)
    assert said == []
    assert found["slider"] and found["linked"] and found["clicked"]
    assert found["rows"] == 1 + 2 * 2  # both designs on both plants
    assert not found["scrolls"]


@needs_chromium
@pytest.mark.slow
def test_a_long_run_stays_small(long_run, tmp_path):
    page = write_page([long_run], tmp_path / "long.html")
    assert page.stat().st_size < MOST_BYTES
    found, said = tried(page, tmp_path)
    assert said == [] and found["slider"]
    print(
        f"{page.stat().st_size} bytes, ready {found['ready']:.0f} ms, {found['times']}",
        file=sys.stderr,
    )

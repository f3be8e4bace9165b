"""The page's structure without a browser; what it does, in Chromium where there is one."""

import json
import re
import shutil
from html.parser import HTMLParser

import pytest
import xarray as xr
from selenium import webdriver
from selenium.common.exceptions import TimeoutException
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from jcontour.app.files.run_folder import RunError
from jcontour.app.reports.page import page_data
from jcontour.app.reports.page.page_data import MOST_BYTES, write_page

CHROMIUM, CHROMEDRIVER = shutil.which("chromium"), shutil.which("chromedriver")
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
    assert found.open == [] and found.loaded == [] and found.labelled == 9
    assert {"part", "error", "control", "feed", "sensitivity", "front"} <= found.ids
    called = set(re.findall(r'\$\("([\w-]+)"\)', text))
    assert called <= found.ids, called - found.ids
    assert not re.search(r"https?://|@import|fetch\(|XMLHttpRequest", text)
    assert set(re.findall(r"@[A-Z]+@", text)) == {"@PLOTS@"}  # of the run alone, and left there


def test_text_of_the_user_is_no_markup(page, nasty):
    text = page.read_text()
    assert nasty not in text and "<img" not in text and "innerHTML" not in text
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert data is not None
    (run,) = json.loads(data[1])
    assert run["machine"] == nasty and run["verdict"] == {
        "usable": False,
        "lines": ["DO NOT USE THESE VALUES", f"  because: {nasty}", "WARNING: it hums"],
    }


def test_too_large_a_page_is_refused(run_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(page_data, "MOST_BYTES", 1000)
    with pytest.raises(RunError, match="give fewer runs"):
        write_page([run_folder], tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Chromium without a window, driven as a user drives it."""
    if CHROMIUM is None or CHROMEDRIVER is None:
        pytest.skip("no Chromium with its driver here: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    profile = tmp_path_factory.mktemp("profile")
    for flag in ("--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile}"):
        options.add_argument(flag)
    driver = webdriver.Chrome(options, webdriver.ChromeService(CHROMEDRIVER))
    yield driver
    driver.quit()


class Shown:
    """A page that is shown in the browser."""

    def __init__(self, browser, page, size):
        self.browser = browser
        browser.set_window_size(*size)
        browser.get(page.as_uri())

    def one(self, name):
        return self.browser.find_element("id", name)

    def picture(self, name):
        return self.browser.execute_script("return arguments[0].toDataURL()", self.one(name))

    def focused(self):
        return self.browser.switch_to.active_element

    def tab_to(self, name):
        """Press the tab key until an element has the focus; it is an error where none gets it."""
        for _ in range(20):
            if self.focused().get_attribute("id") == name:
                return self.focused()
            self.focused().send_keys(Keys.TAB)
        raise AssertionError(f"{name} is not reached with the tab key")

    def changes(self, seen, act):
        """Whether what is seen is another soon after an action."""
        before = seen()
        act()
        try:
            return WebDriverWait(self.browser, 5, 0.02).until(lambda _: seen() != before)
        except TimeoutException:
            return False


SIZES = pytest.mark.parametrize("size", [(1200, 900), (500, 800)], ids=["desk", "phone"])


@SIZES
def test_the_page_works_with_the_mouse(browser, page, size):
    shown = Shown(browser, page, size)
    factor = shown.one("factor")
    assert shown.changes(
        lambda: shown.picture("part"),
        lambda: ActionChains(browser).move_to_element_with_offset(factor, 60, 0).click().perform(),
    )
    x, y = browser.execute_script(
        """const plot = views.front, worst = plot.ys.indexOf(Math.max(...plot.ys));
        const box = $("front").getBoundingClientRect();
        return [plot.px(plot.xs[worst]) - box.width / 2, plot.py(plot.ys[worst]) - box.height / 2];
        """
    )
    front = shown.one("front")
    assert shown.changes(
        lambda: shown.one("point-weights").text,
        lambda: ActionChains(browser).move_to_element_with_offset(front, x, y).click().perform(),
    )
    assert "error 10 um" in shown.one("point-weights").text  # the worst of the four
    error = shown.one("error")
    assert shown.changes(
        lambda: (shown.picture("part"), shown.one("readout").text),
        lambda: ActionChains(browser).move_to_element_with_offset(error, 40, 0).perform(),
    )
    assert not browser.execute_script(
        "return document.documentElement.scrollWidth > window.innerWidth"
    )
    assert browser.get_log("browser") == []


def test_the_page_works_with_the_keyboard_alone(browser, page, run_folder):
    """It opens on the run of the tuned weights with the largest peak."""
    shown = Shown(browser, page, (1200, 900))
    peaks = xr.load_dataset(run_folder / "rollouts.nc").peak_contour_error.values[1]
    contour, plant = 0, peaks[0].argmax()  # the part; the other contour is held out
    opened = [shown.one(name).get_property("value") for name in ("contour", "plant")]
    assert opened == [str(contour), str(plant)]

    def pressed(name, key, *seen):
        chosen = shown.tab_to(name)
        return shown.changes(lambda: [see() for see in seen], lambda: chosen.send_keys(key))

    def text(name):
        return lambda: shown.one(name).text

    def picture(name):
        return lambda: shown.picture(name)

    assert pressed("contour", Keys.ARROW_DOWN, text("metrics"))
    assert pressed("plant", Keys.END, text("readout"))
    assert pressed("along", Keys.ARROW_DOWN, text("error-title"))
    assert pressed("factor", Keys.ARROW_LEFT, picture("part"), text("factor-value"))
    assert pressed("zoom", Keys.ARROW_RIGHT, picture("part"), text("zoom-value"))
    assert pressed("cursor", Keys.HOME, text("readout"))
    assert pressed("point", Keys.ARROW_DOWN, text("point-weights"))
    assert browser.get_log("browser") == []


def test_a_long_run_stays_small(browser, long_run, tmp_path):
    page = write_page([long_run], tmp_path / "long.html")
    assert page.stat().st_size < MOST_BYTES
    shown = Shown(browser, page, (1200, 900))
    assert shown.changes(
        lambda: shown.picture("part"), lambda: shown.one("factor").send_keys(Keys.ARROW_LEFT)
    )
    assert browser.get_log("browser") == []

"""The report in Chromium: it asks no host, reports no error, fits a phone, prints on whole pages and passes the checks of axe."""

import base64
import io
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pypdfium2 as pdfium
import pytest
from browser import READY, Page
from PIL import Image

from runout.report.html import write_report

AXE = find_spec("axe_core_python")
LEAST_CHECKS = 15  # of axe, that find something to check on the page
pytestmark = pytest.mark.usefixtures("browser")
WIDE = """(() => {
    const beyond = (element) => element.getBoundingClientRect().right > document.documentElement.clientWidth + 1;
    const own = (element) => !element.closest(".scroll, .explorer, svg, .skip");
    const wide = [...document.querySelectorAll("body *")].filter((element) => beyond(element) && own(element));
    return wide.slice(0, 5).map((element) => element.outerHTML.slice(0, 90));
})()"""

CORNER = """(() => {
    const box = document.getElementById("explorer-map").getBoundingClientRect();
    return [box.left + scrollX, box.top + scrollY];
})()"""

BROKEN = """(() => {
    const narrow = [...document.querySelectorAll("table.text:not(.stack) td")].filter((cell) => cell.getBoundingClientRect().width);
    return narrow.filter((cell) => cell.getBoundingClientRect().width < 60).map((cell) => cell.textContent.trim().slice(0, 60));
})()"""

SCALES = """(() => {
    const map = Bokeh.documents.flatMap((document) => document.roots()).find((model) => model.x_range && model.y_range);
    const length = (range) => range.end - range.start;
    return [length(map.x_range) / map.inner_width, length(map.y_range) / map.inner_height];
})()"""


@pytest.fixture(scope="module")
def path(site, results):
    return write_report(site, results)


@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_asks_no_host_reports_no_error_and_does_not_scroll_sideways(path, width, tmp_path):
    with Page(tmp_path, width=width) as page:
        page.open(path, READY)
        assert page.run("document.documentElement.scrollWidth") <= width
        assert page.run(WIDE) == []
        east, north = page.run(SCALES)
        assert east == pytest.approx(north, rel=1e-3)  # the map has one scale
        assert page.errors == []
        assert page.requests == []
        assert page.run("getComputedStyle(document.querySelector('.sheets')).display") == "none"
        assert rim_of_the_map(page) == {(255, 255, 255)}  # no rest of a label that was drawn before the map had its size
        assert page.run(BROKEN) == []


def rim_of_the_map(page):
    """Colours of the two uppermost rows of pixels left of the frame of the map."""
    page.run("new Promise((done) => setTimeout(done, 500))")  # the map draws its pictures after it is ready
    left, top = page.run(CORNER)
    clip = {"x": left, "y": top, "width": 40, "height": 2, "scale": 1}
    picture = page.call("Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True)
    return set(Image.open(io.BytesIO(base64.b64decode(picture["data"]))).convert("RGB").getdata())


@pytest.mark.skipif(AXE is None, reason="needs axe-core-python, of the extra test")
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_axe_finds_no_violation_of_wcag(path, dark, tmp_path):
    axe = (Path(AXE.origin).parent / "axe.min.js").read_text(encoding="utf-8")
    rules = "{runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa']}"
    with Page(tmp_path, dark=dark) as page:
        page.open(path, READY)
        page.run(f"{axe};0")
        violations = "r.violations.map((v) => [v.id, v.nodes.map((n) => n.html)])"
        answer = f"axe.run(document, {rules}).then((r) => [r.passes.length, {violations}])"
        passed, violations = page.run(answer)
        assert page.run("matchMedia('(prefers-color-scheme: dark)').matches") is dark
    assert passed >= LEAST_CHECKS
    assert violations == []


def test_the_print_has_one_sheet_a_map_and_no_empty_page(path, tmp_path):
    with Page(tmp_path) as page:
        page.open(path, READY)
        printed = page.print_pdf()
    with pdfium.PdfDocument(printed) as document:
        texts = [sheet.get_textpage().get_text_bounded() for sheet in document]
    assert 7 <= len(texts) <= 14
    assert all(f"{k} / {len(texts)}" in text for k, text in enumerate(texts, 1))
    assert all(len(text.split()) > 25 for text in texts), "no empty page"
    assert [number for text in texts for number in re.findall(r"\b(\d) of 5\b", text)] == list("12345")


def test_the_pictures_of_the_guide_are_made_of_a_report(path, tmp_path):
    repository = Path(__file__).parents[2]
    script = [sys.executable, str(repository / "docs" / "make_report_pictures.py"), str(path), str(tmp_path)]
    done = subprocess.run(script, capture_output=True, text=True, check=True, timeout=300, cwd=repository)
    pictures = {Path(line).name: Image.open(line) for line in done.stdout.splitlines()}
    assert pictures["report_desk.png"].size == (1280, 1500)
    assert pictures["report_phone.png"].size == (390, 1500)
    for name, picture in pictures.items():
        assert len(picture.convert("RGB").getcolors(1 << 24)) > 50, f"{name} is nearly empty"
    assert pictures["report_sheet.png"].height > 500

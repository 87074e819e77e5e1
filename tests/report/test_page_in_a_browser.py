"""The report in Chromium: it asks no host, reports no error, fits a phone, prints on whole pages and passes the checks of axe."""

import html
import json
import re
import shutil
import socket
import subprocess
import threading
from importlib.util import find_spec
from pathlib import Path

import pytest

from runout.report.html import write_report

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000", "--allow-file-access-from-files")
AXE = find_spec("axe_core_python")
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine")
LEAST_CHECKS = 15  # of axe, that find something to check on the page


def browse(path, *flags):
    """Standard output and messages of the browser on a page."""
    command = [BROWSER, *FLAGS, *flags, path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, done.stderr


def output_of(dom, name):
    """JSON that a script of the test left in the element ``name``."""
    return json.loads(html.unescape(re.search(rf'<pre id="{name}">(.*?)</pre>', dom, re.DOTALL)[1]))


def with_script(path, script, target):
    """Copy of a page with a further script at its end."""
    head, _, tail = path.read_text(encoding="utf-8").rpartition("</body>")
    target.write_text(f"{head}<script>{script}</script></body>{tail}", encoding="utf-8")
    return target


@pytest.fixture(scope="module")
def page(site, results):
    return write_report(site, results)


@pytest.fixture
def proxy():
    """A proxy that answers nothing, and the connections that it received."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        asked = []

        def listen():
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                with connection:
                    asked.append(connection.recv(300))

        threading.Thread(target=listen, daemon=True).start()
        yield server.getsockname()[1], asked


def test_the_page_asks_no_host_and_reports_no_error(page, proxy, tmp_path):
    port, asked = proxy
    flags = (f"--proxy-server=127.0.0.1:{port}", "--proxy-bypass-list=<-loopback>", "--enable-logging=stderr", "--dump-dom")
    quiet = ("--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run")
    dom, messages = browse(page, *flags, *quiet)
    shown = re.sub(r"<script\b[^>]*>.*?</script>", "", dom, flags=re.DOTALL)
    assert "The map cannot be drawn" not in shown
    assert not [line for line in messages.splitlines() if "CONSOLE" in line]
    hosts = {request.split(b"\r\n")[0] for request in asked}
    assert not hosts, hosts
    loading = with_script(page, "fetch('http://192.0.2.1/x').catch(() => 0)", tmp_path / "loading.html")
    browse(loading, *flags, *quiet)
    assert asked, "the proxy sees what a page asks for"


@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_does_not_scroll_sideways(page, width, tmp_path):
    frame = tmp_path / "frame.html"
    script = """setTimeout(() => {
        const page = document.getElementById("page").contentDocument, root = page.documentElement;
        const beyond = (element) => element.getBoundingClientRect().right > root.clientWidth + 1;
        const wide = [...page.querySelectorAll("main *")].filter((e) => beyond(e) && !e.closest(".scroll, .explorer, svg"));
        const out = document.createElement("pre");
        out.id = "size";
        out.textContent = JSON.stringify([root.scrollWidth, root.clientWidth, wide.slice(0, 5).map((e) => e.outerHTML.slice(0, 90))]);
        document.body.append(out);
    }, 4000)"""
    look = f"width:{width}px;height:2000px;border:0"
    frame.write_text(f'<iframe id="page" src="{page.as_uri()}" style="{look}"></iframe><script>{script}</script>')
    dom, _ = browse(frame, f"--window-size={width + 60},2100", "--dump-dom")
    scrolled, shown, wide = output_of(dom, "size")
    assert shown in (width, width - 15)  # with or without a scroll bar
    assert scrolled <= shown
    assert wide == []


@pytest.mark.skipif(AXE is None, reason="axe-core-python is not installed")
@pytest.mark.parametrize("look", [(), ("--blink-settings=preferredColorScheme=0",)], ids=["light", "dark"])
def test_axe_finds_no_violation_of_wcag(page, look, tmp_path):
    axe = (Path(AXE.origin).parent / "axe.min.js").read_text(encoding="utf-8").replace("</script", "<\\/script")
    script = (
        f"{axe};setTimeout(() => axe.run(document, {{runOnly: ['wcag2a', 'wcag2aa']}}).then(found => {{"
        "const out = document.createElement('pre'); out.id = 'axe'; out.textContent = JSON.stringify([found.passes.length,"
        "found.violations.map(one => [one.id, one.nodes.slice(0, 3).map(node => node.html.slice(0, 200))])]);"
        "document.body.append(out); }), 4000)"
    )
    dom, _ = browse(with_script(page, script, tmp_path / "axe.html"), *look, "--dump-dom")
    passed, violations = output_of(dom, "axe")
    assert passed >= LEAST_CHECKS
    assert violations == []


def test_the_print_has_one_sheet_a_map_and_no_empty_page(page, tmp_path):
    printed = tmp_path / "report.pdf"
    browse(page, "--no-pdf-header-footer", f"--print-to-pdf={printed}")
    pages = len(re.findall(rb"/Type /Page\b", printed.read_bytes()))
    assert 7 <= pages <= 14
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext on this machine: pages are counted, not read")
    said = subprocess.run(["pdftotext", "-layout", str(printed), "-"], capture_output=True, text=True, check=True).stdout
    texts = said.split("\f")[:pages]
    assert all(f"{k} / {pages}" in text for k, text in enumerate(texts, 1))
    assert all(len(text.split()) > 25 for text in texts), "no empty page"
    assert [number for text in texts for number in re.findall(r"\b(\d) of 5\b", text)] == list("12345")

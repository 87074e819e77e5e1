"""Opens what a run has written: the report in the browser, the project in QGIS."""

import logging
import os
import shutil
import subprocess
import sys
import webbrowser
from pathlib import Path
from shlex import quote

from runout import log
from runout.errors import InputError, LibraryError
from runout.workflow.study import PLAN, Study

LOGGER = logging.getLogger("runout.opening")
REPORT = "report.html"


def has_display() -> bool:
    """Whether a window can be opened."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_page(page: Path) -> bool:
    """Open a page in the browser and print its path; returns whether a browser has started."""
    log.output().print(str(page), markup=False)
    started = bool(os.environ.get("BROWSER") or has_display()) and webbrowser.open(page.absolute().as_uri())
    if not started:
        LOGGER.info("no browser can be started here; copy the file to a machine that has one")
    return started


def open_results(site_path: Path, out: Path | None = None, *, qgis: bool = False) -> None:
    """Open the report of a site, or with ``qgis`` its project.

    Raises InputError if there is no such file; the message names the command that makes it. Raises LibraryError if there is no
    QGIS.
    """
    study = Study.open(site_path, out)
    file = next(iter(sorted(study.results.glob("*.qgz"))), None) if qgis else study.results / REPORT
    if file is None or not file.is_file():
        options = "" if out is None else f" --out {quote(str(out))}"
        raise InputError(f"{file or study.results / '*.qgz'}: not there; run `runout run {quote(str(site_path))}{options}` first")
    if reason := study.why_stale(PLAN[-1]):
        LOGGER.warning("%s is not up to date: %s; `runout run` makes it again", file.name, reason)
    if qgis:
        _open_in_qgis(file)
    else:
        open_page(file)


def _open_in_qgis(project: Path) -> None:
    log.output().print(str(project), markup=False)
    command = shutil.which("qgis")
    if command is None:
        raise LibraryError(f"there is no command qgis on the PATH; open {project} from QGIS, or add its folder to the PATH")
    subprocess.Popen([command, str(project)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)

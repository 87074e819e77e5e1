"""The command ``runout``: where it is installed, the environment it gets, its lines as progress, and its end."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import TextIO

from processing.core.ProcessingConfig import ProcessingConfig
from qgis import core

SETTING = "RUNOUT_COMMAND"
OF_QGIS = ("PYTHONHOME", "PYTHONPATH", "PROJ_DATA", "PROJ_LIB", "GDAL_DATA", "GDAL_DRIVER_PATH", "QT_PLUGIN_PATH")
WINDOWS = sys.platform == "win32"
OK, PARTIAL = 0, 3  # exit codes: all is done; some members failed, or none is done
GRACE = 10.0  # [s] between the request to end and the end by force
STAGES = {"terrain": 2.0, "release": 4.0, "ensemble": 90.0, "hazard": 97.0, "report": 100.0}  # [%] when each is done
MEMBERS = (re.compile(r"^member .* (\d+) of (\d+)$"), re.compile(r", (\d+) of (\d+) members, \d+ %"))  # that are done
PROBLEM = re.compile(r"^(problem |error: )")
INSTALL = (
    "Install it in an environment of its own, for example with `pipx install runout`; then name the path of the command, or of the "
    "Python of that environment, in Settings > Options > Processing > Providers > runout."
)


def located() -> list[str]:
    """First words of a call of the command: that of the settings, else the one on the PATH or where pipx puts it.

    QgsProcessingException if there is none; the message says how to install it.
    """
    named = str(ProcessingConfig.getSetting(SETTING) or "").strip()
    if not named:
        usual = os.pathsep.join((os.environ.get("PATH", ""), str(Path.home() / ".local" / "bin")))
        command = shutil.which("runout", path=usual)
        if command is None:
            raise core.QgsProcessingException(f"The command runout is not on the PATH. {INSTALL}")
        return [command]
    path = Path(named).expanduser()
    if path.is_dir():  # an environment
        inside = [path / "bin" / "runout", path / "Scripts" / "runout.exe", path / "runout", path / "runout.exe"]
        path = next((one for one in inside if one.is_file()), path)
    if not path.is_file():
        raise core.QgsProcessingException(f"{named}: there is no command runout, which the settings of Processing name. {INSTALL}")
    return [str(path), "-m", "runout"] if path.name.lower().startswith("python") else [str(path)]


def environment() -> dict[str, str]:
    """Environment of the command, without what QGIS sets for its own Python, PROJ and GDAL."""
    kept = {name: value for name, value in os.environ.items() if name not in OF_QGIS}
    return {**kept, "PYTHONIOENCODING": "utf-8", "PYTHONUNBUFFERED": "1"}


def run(arguments: Sequence[object], feedback: core.QgsProcessingFeedback) -> list[str]:
    """Lines of a call of the command, which are also shown in the log while it runs.

    QgsProcessingException if the command cannot be started, is cancelled, or ends with an error; it holds the problems.
    """
    words = [*located(), *map(str, arguments)]
    feedback.pushCommandInfo(shlex.join(words))
    own_group = {"creationflags": 0x08000200} if WINDOWS else {"start_new_session": True}  # no window, new process group
    try:
        process = subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment(),
            encoding="utf-8", errors="replace", **own_group,
        )  # fmt: skip
    except OSError as error:
        raise core.QgsProcessingException(f"{words[0]}: cannot be started ({error.strerror}). {INSTALL}") from error
    lines = []
    for line in _lines_until_the_end(process, feedback):
        lines.append(line)
        _show(line, feedback)
    if feedback.isCanceled():
        raise core.QgsProcessingException("Cancelled; finished members are kept, and the same algorithm continues.")
    if process.returncode == PARTIAL and not any(line.startswith("error: ") for line in lines):
        feedback.reportError("Some members failed; the products say how many are missing.")
    elif process.returncode != OK:
        raise core.QgsProcessingException(problems(lines) or f"The command ended with exit code {process.returncode}.")
    return lines


def problems(lines: Sequence[str]) -> str:
    """The problems among the lines of a command: each that check lists, and the error that ended it with all its lines."""
    error = next((k for k, line in enumerate(lines) if line.startswith("error: ")), len(lines))
    listed = [line for line in lines[:error] if PROBLEM.match(line)]
    return "\n".join([*listed, *lines[error:]] or lines[-15:])


def progress(line: str) -> float | None:
    """Finished share [%] of a run that a line states; None if it states none."""
    if (stage := line.partition(": done in ")[0]) in STAGES and stage != line:
        return STAGES[stage]
    stated = next(filter(None, (form.search(line) for form in MEMBERS)), None)
    before, after = STAGES["release"], STAGES["ensemble"]
    return None if stated is None else before + (after - before) * int(stated[1]) / max(int(stated[2]), 1)


def _show(line: str, feedback: core.QgsProcessingFeedback) -> None:
    share = progress(line)
    if share is not None:
        feedback.setProgress(share)
    if PROBLEM.match(line):
        feedback.reportError(line)
    elif line.startswith("warning"):
        feedback.pushWarning(line)
    else:
        feedback.pushInfo(line)


def _lines_until_the_end(process: subprocess.Popen, feedback: core.QgsProcessingFeedback) -> Iterator[str]:
    """Lines of a process as they come; a cancel ends it with all processes that it started."""
    queue: Queue = Queue()
    Thread(target=_read, args=(process.stdout, queue), daemon=True).start()
    while True:
        if feedback.isCanceled():
            _end(process)
            return
        try:
            line = queue.get(timeout=0.2)
        except Empty:
            continue
        if line is None:
            process.wait()
            return
        yield line


def _read(stream: TextIO, queue: Queue) -> None:
    with stream:
        for line in stream:
            queue.put(line.rstrip())
    queue.put(None)


def _end(process: subprocess.Popen) -> None:
    """End a process and its group: by request, and by force if it is still there after a while."""
    if WINDOWS:
        subprocess.run(["taskkill", "/T", "/F", "/PID", str(process.pid)], capture_output=True, check=False)
        process.wait()
        return
    _signal_group(process, signal.SIGTERM)
    with suppress(subprocess.TimeoutExpired):
        process.wait(GRACE)
    _signal_group(process, signal.SIGKILL)  # members that are left
    process.wait()


def _signal_group(process: subprocess.Popen, number: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, number)  # the process leads its group

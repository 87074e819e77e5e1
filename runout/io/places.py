"""Checks, before any work, that a file or folder that an option names can be written."""

import os
import tempfile
from pathlib import Path

from runout.errors import ConfigError
from runout.io.boundary import exists, irregular, kind_of
from runout.processes.caches import fault_of_owner

ELSEWHERE = "name another place"
OTHERWISE = "or choose another folder with --out"
RESULT_FILES = (  # endings in a results folder
    *(".nc", ".gpkg", ".html", ".json", ".log", ".tif", ".csv", ".png", ".svg", ".qgz", ".kmz", ".txt", ".xml"),
)
SECOND_GRID = "second_grid"  # folder in the results with the same members on larger cells
RESULT_FOLDERS = (
    SECOND_GRID,
    *("members", "maps", "probes", "profiles", "simulations", "animations", "scarp", "screen", "slopes"),
    *("sensitivity", "calibration", ".locks"),
)
RESULT_RECORD = "stages.json"  # a folder that holds it is one of results


def require_place(option: str, path: Path, *, folder: bool) -> None:
    """Raise ConfigError, which names the option, unless a file or ``folder`` can be made or replaced at ``path``.

    Folders that are missing on the way will be made; nothing is left behind by the check.
    """
    fault = _fault(path, folder)
    if fault:
        raise ConfigError(f"{option} {path}: {fault}")


def require_results(option: str, results: Path) -> None:
    """Raise ConfigError, which names the option, unless a results folder can be made or its files replaced."""
    require_place(option, results, folder=True)
    fault = fault_in_results(results)
    if fault:
        raise ConfigError(f"{option} {fault}")


def require_own_results(results: Path) -> None:
    """Raise ConfigError if something else lies in the place of a results folder, of one of its files or folders.

    The folder may itself be a link, see :func:`fault_in_results`; links in it would let a run write and remove files elsewhere.
    """
    fault = fault_in_results(results)
    if fault:
        raise ConfigError(fault)


def fault_in_results(results: Path) -> str:
    """What lies in the place of a results folder, of one of its files or folders, with the remedy; empty if nothing does.

    The folder may be a link to another disk, if the user owns what it names, and nothing but results lies there.
    """
    if exists(results) and not results.is_dir():
        return f"{results}: is a file; name a folder"
    if results.is_symlink() and (fault := _fault_of_link(results)):
        return f"{results}: is a link to {os.path.realpath(results)}, {fault}; remove the link, {OTHERWISE}"
    strange = irregular(results)
    if strange:
        more = f", and {len(strange) - 1} more" if len(strange) > 1 else ""
        path, kind = strange[0]
        return f"{path}: is {kind}{more}; results are files and folders, and no links: remove it, {OTHERWISE}"
    places = [results, *(results / name for name in RESULT_FOLDERS if (results / name).is_dir())]
    strange_paths = [path for place in places for path in _strange(place)]
    if not strange_paths:
        return ""
    kind, wanted = ("folder", "file") if strange_paths[0].is_dir() else ("file", "folder")
    more = f", and {len(strange_paths) - 1} more" if len(strange_paths) > 1 else ""
    return f"{strange_paths[0]}: is a {kind} where results have a {wanted}{more}; remove it, {OTHERWISE}"


def _fault_of_link(results: Path) -> str:
    """Why results do not go where a link in the place of their folder leads; empty if they do."""
    try:
        owner, names = fault_of_owner(results.stat()), sorted(os.listdir(results))
    except OSError as cause:
        return f"which cannot be read ({cause.strerror})"
    if owner:
        return f"which {owner}"
    if RESULT_RECORD in names:
        return ""
    others = [name for name in names if not _is_of_results(name)]
    return f"which holds other files, such as {others[0]}" if others else ""


def _is_of_results(name: str) -> bool:
    """Whether a results folder may hold a file or folder of this name."""
    return name in RESULT_FOLDERS or name.endswith((*RESULT_FILES, ".lock", ".part"))


def _strange(folder: Path) -> list[Path]:
    """Folders of a results folder that have the ending of a file, and files that have the name of a folder."""
    try:
        with os.scandir(folder) as entries:
            listed = [(entry.name, entry.is_dir()) for entry in entries]
    except OSError:  # it is missing or cannot be read; the first access reports it
        return []
    strange = [n for n, is_folder in listed if (Path(n).suffix in RESULT_FILES if is_folder else n in RESULT_FOLDERS)]
    return [folder / name for name in sorted(strange)]


def _fault(path: Path, folder: bool) -> str:
    """What keeps a path from being written, with the remedy; empty if nothing does."""
    absolute = Path(os.path.abspath(path))
    if fault := _no_name(absolute):
        return fault
    if kind := kind_of(absolute):
        return f"is {kind}; {ELSEWHERE}"
    if absolute.is_dir() and not folder:
        return "is a folder; name a file in it"
    if exists(absolute) and not absolute.is_dir() and folder:
        return "is a file; name a folder"
    there = absolute if absolute.is_dir() else absolute.parent
    while not exists(there):
        there = there.parent
    if not there.is_dir():
        return f"{there} is a file, not a folder; {ELSEWHERE}"
    return _refused(there)


def _refused(folder: Path) -> str:
    """Why nothing can be written to a folder that exists."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as cause:
        return f"nothing can be written in {folder} ({cause.strerror}); change its permissions, or {ELSEWHERE}"


def _no_name(path: Path) -> str:
    """Why the system takes a path for no name."""
    if "\0" in str(path):
        return f"no name holds a null character; {ELSEWHERE}"
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return ""
    except OSError as cause:
        return f"{cause.strerror}; {ELSEWHERE}"
    return ""

"""Questions of ``runout new`` at a terminal: each answer is checked at once and becomes an option of the command."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from shlex import join
from typing import Any

from runout.errors import InputError
from runout.io.boundary import names_in

RASTERS = (".tif", ".tiff", ".asc", ".vrt", ".img")
POLYGONS = (".gpkg", ".shp", ".geojson", ".fgb")
NONE = "none"
Check = Callable[[str], object]  # raises an InputError if an answer cannot be used


def with_answers(tokens: Sequence[str]) -> list[str]:
    """Arguments of a command: those of ``runout new`` or ``runout new FOLDER`` at a terminal with answers as options.

    Other arguments stay as they are, and so do these where standard input or standard error is no terminal.

    Raises InputError if the input ends before the last answer.
    """
    arguments = [token for token in tokens[1:] if not token.startswith("-")]
    asks = list(tokens[:1]) == ["new"] and len(tokens) == 1 + len(arguments) <= 2 and sys.stdin.isatty() and sys.stderr.isatty()
    if not asks:
        return list(tokens)
    from runout.config.scaffold import require_free

    for folder in arguments:
        require_free(Path(folder))
    _complete_names()
    _say("Enter takes the answer in brackets, Tab completes names, Ctrl-C leaves everything as it is.")
    made = ["new", arguments[0] if arguments else _asked("Folder of the new site", "site", lambda name: require_free(Path(name)))]
    made += _of_process()
    dem = _asked("Elevation raster (DEM)", _only(RASTERS), _readable_dem)
    release = _asked("Release: polygons, or a raster of thickness", _only(POLYGONS), _readable_release)
    made += ["--dem", dem, "--release", release, *_of_numbers(dem, release)]
    _say(f"\nThe same without questions:\n  runout {join(made)}\n")
    return made


def _say(text: str) -> None:
    print(text, file=sys.stderr)


def _asked(question: str, default: str = "", check: Check | None = None) -> str:
    """An answer that passes a check; the message of one that does not is shown, and the question asked again."""
    while True:
        sys.stderr.write(f"{question}{f' [{default}]' if default else ''}: ")
        sys.stderr.flush()
        try:
            answer = input().strip().strip("'\"") or default
            if not answer:
                _say("  an answer is needed")
                continue
            if check is not None:
                check(answer)
            return answer
        except EOFError:
            raise InputError("the input ended before the last answer; nothing was made") from None
        except InputError as error:
            _say(f"  {error}")


def _of_process() -> list[str]:
    from runout.config.process_ranges import process_named, processes

    names = [*processes(), NONE]
    for number, process in enumerate(processes().values(), 1):
        _say(f"  {number}  {process.title}: {'; '.join(r.stated().partition(' (')[0] for r in process.of_friction)}")
    _say(f"  {len(names)}  {NONE} of these: friction is a placeholder, not a published value")

    def named(answer: str) -> str:
        return names[int(answer) - 1] if answer.isdecimal() and 1 <= int(answer) <= len(names) else answer

    answer = named(_asked("Process, number or name", check=lambda text: named(text) == NONE or process_named(named(text))))
    return [] if answer == NONE else ["--process", answer]


def _only(endings: tuple[str, ...]) -> str:
    """The file of the working folder with one of some endings; empty if there are several or none."""
    names = [name for name in names_in(Path()) if name.lower().endswith(endings)]
    return names[0] if len(names) == 1 else ""


def _readable_dem(answer: str) -> None:
    from runout.config.scaffold import SAMPLES, missing
    from runout.terrain.read import read_header

    if not answer.startswith(SAMPLES) and (fault := missing(answer, "elevation")):
        raise InputError(fault)
    read_header(answer)


def _readable_release(answer: str) -> None:
    from runout.config.scaffold import missing

    if fault := missing(answer, "release"):
        raise InputError(fault)


def _of_numbers(dem: str, release: str) -> list[str]:
    """Options with the thickness of polygons and the grid spacing; a raster holds its own thickness."""
    from runout.config.scaffold import cell_and_release
    from runout.io.references import holds_geometries
    from runout.model.limits import checked

    def read(thickness: str | None) -> tuple[float, dict[str, Any]]:
        return cell_and_release(dem, release, thickness, None, None)

    def is_size(answer: str) -> None:
        try:
            checked("cell_size", float(answer), key="the cell size")
        except ValueError:
            raise InputError(f"{answer!r} is not a number of metres") from None

    options = []
    polygons = holds_geometries(Path(release))
    cell, _ = read("1" if polygons else None)
    if polygons:
        question = "Thickness of the release: an attribute of the polygons, or vertical metres"
        options = ["--thickness", _asked(question, _attribute(read), read)]
    answer = _asked("Cell size [m]; at most a quarter of the flow depth is recommended", f"{cell:g}", is_size)
    return [*options, "--cell-size", answer]


def _attribute(read: Callable[[None], tuple[float, dict[str, Any]]]) -> str:
    """Attribute of the polygons whose name means thickness; empty if there are none or several, which a message names."""
    try:
        thickness = read(None)[1]["thickness"]
    except InputError as error:
        _say(f"  {error}")
        return ""
    return thickness if isinstance(thickness, str) else ""


def _complete_names() -> None:
    """Let Tab complete names of files, where the terminal can."""
    try:
        import readline
    except ImportError:  # Windows
        return
    readline.set_completer_delims("\t\n")
    readline.parse_and_bind("tab: complete")

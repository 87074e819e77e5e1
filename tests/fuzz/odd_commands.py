"""Calls of every command with odd options, on sites with faults and in results folders with odd content."""

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

from odd_sites import write_good, write_odd_site
from odd_values import BLOCKS, NUMBERS, PATHS, TEXTS, mutated

import runout
from runout import cli
from runout.errors import ExitCode, StabilityError
from runout.simulation import single
from runout.studies import stability_stress, verification, work_precision
from runout.workflow import doctor, hazard_map

# values of options and folders that a command writes: nothing outside of the working directory
WRITTEN = ["new", "site.yaml", "site/inputs/dem.tif/x", "site/inputs/pipe", "x" * 300, "con\nfused", "site", "a.tif", "film.gif",
           "film.mp4", "out.json", "\u202etxt", "-x", " ", "site/inputs/loop/x"]  # fmt: skip
PLACES = ("site", "first", "second")
WRITING = ("folder", "output", "vtk", "json", "figure", "out", "name")
GOOD = {
    "dem": "site/inputs/dem.tif", "release": "site/inputs/release.geojson", "line": "site/inputs/line.geojson", "member": "0",
    "points": "site/inputs/points.geojson", "cross_sections": "site/inputs/line.geojson", "quantity": "thickness", "size": "64 48",
    "outline": "site/inputs/zone.geojson", "ellipsoid": "500080 5000060 40 30 5", "plane": "500080 5000060 5 10 90",
    "workers": "1", "threads": "1", "members": "0:1", "camera": "top", "thickness": "depth", "frames": "2", "snapshots": "2",
}  # fmt: skip
RECORDS = (
    *("stages.json", "checksums.json", "inputs.json", "run.json", "sampling.json", "convergence.json", "run.log"),
    *("terrain.nc", "release.nc", "hazard.nc", "members.nc", "structures.nc", "report.html", "outlines.gpkg", "members/x.nc"),
    *("members/0123456789abcdef.nc", "members/0123456789abcdef.failed.json", "members/0123456789abcdef.checkpoint.npz"),
    *("members/.lock", ".locks/terrain", "maps/peak_speed.tif", "simulations/0000.nc", "probes/x.nc", ".x.nc.abc.part"),
)
SITES = ["site"] * 12 + [
    "site/site.yaml",
    "nowhere",
    "site/inputs",
    "site/inputs/dem.tif",
    "site/inputs/pipe",
    "",
    "x" * 5000,
    "a\0b",
]


def odd_results(folder: Path, random: Random) -> None:
    """Records and products of a results folder that hold something else, or that are links, pipes or folders."""
    for name in random.sample(RECORDS, random.choice([1, 1, 2, 5])):
        path = folder / "results" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        kind = random.choice(["json", "json", "json", "bytes", "bytes", "link", "pipe", "folder", "raster"])
        if kind == "json":
            path.write_text(odd_json(random), encoding="utf-8", errors="surrogatepass")
        elif kind == "bytes":
            path.write_bytes(random.choice([b"", random.randbytes(99), b"\x89HDF\r\n\x1a\n" + random.randbytes(99), b"CDF\x01"]))
        elif kind == "raster":
            path.write_bytes(mutated((folder / "inputs" / "dem.tif").read_bytes(), random))
        elif kind == "link":
            path.symlink_to(random.choice(["nowhere", "../inputs", "../site.yaml", path.name]))
        elif kind == "pipe":
            os.mkfifo(path)
        else:
            path.mkdir()


def odd_json(random: Random) -> str:
    """Text of a record, mostly valid JSON of another kind than expected."""
    key = random.choice(["terrain", "hazard", "x.nc", "files", "values", "key", "levels", "2", "a" * 64])
    value: Any = random.choice([None, 5, -1, 1e308, "x", [], {}, [1], {"key": 5}, {"key": None, "files": {}}, {"files": []}, True])
    entry: Any = {"key": "k", "files": {"x": {"sha256": "x", "size": -1, "inode": 0, "modified": 0, "changed": 0, "noted": 0}}}
    content: Any = random.choice(
        [value, {key: value}, {key: entry}, {key: {key: value}}, [value], {key: {"file": entry, "key": "k"}}]
    )
    text = json.dumps(content)
    return text if random.random() < 0.8 else mutated(text.encode(), random).decode("utf-8", "replace")


def odd_call(random: Random) -> list[str]:
    """Tokens of a call of any command, with some of its options."""
    name = random.choice(cli.COMMANDS).__name__.replace("_", "-")
    tokens = [name]
    for argument in cli.app[name].assemble_argument_collection():
        names = [one for one in argument.names if one.startswith("-")]
        if argument.field_info.is_keyword_only and names and argument.parameter.parse is not False:
            if argument.required or random.random() < 0.15:
                tokens += _option(random.choice(names), argument.hint, random)
        elif argument.field_info.is_positional:
            tokens.append(random.choice(SITES) if argument.name.strip("-") in PLACES else _value(argument.name.strip("-"), random))
    if name in ("run", "ensemble", "probe") and "--workers" not in tokens:
        tokens += ["--workers", "1"]
    if random.random() < 0.1:
        tokens += random.choice([["-v"], ["-q"], ["--out", random.choice(WRITTEN)], ["--nope"], ["--out"], ["--help"]])
    if random.random() < 0.02:
        tokens[0] = random.choice(["", "chekc", "-", "--", "site", "help", "\u202e"])
    return tokens


def _option(option: str, hint: Any, random: Random) -> list[str]:
    return [option] if hint is bool else [option, *_value(option.strip("-").replace("-", "_"), random).split(" ")]


def _value(name: str, random: Random) -> str:
    if name in WRITING:
        return random.choice(WRITTEN)
    if name in GOOD and random.random() < 0.5:
        return GOOD[name]
    number = random.choice([*NUMBERS, "0", "1", "2", "1 2", "nan", "inf", "1e9"])
    return random.choice([number, number, random.choice(TEXTS), random.choice(PATHS), random.choice(BLOCKS)])[:10_000]


def call_odd_command(folder: Path, seed: int) -> int:
    """Call a command in a folder with the site of a seed, odd or good, and maybe odd results; the exit code."""
    random = Random(seed)
    if random.random() < 0.4:
        write_odd_site(folder / "site", seed)
    else:
        write_good(folder / "site", full=random.random() < 0.5)
    if random.random() < 0.5:
        odd_results(folder / "site", random)
    before, tokens = Path.cwd(), odd_call(random)
    os.chdir(folder)
    try:
        with without_work():
            code = cli.main(tokens)
    finally:
        os.chdir(before)
    assert code in set(ExitCode), (tokens, code)
    return code


@contextlib.contextmanager
def without_work() -> Iterator[None]:
    """Members fail, nothing is compiled, and studies of this machine measure nothing."""

    def simulate(**_: Any) -> None:
        raise StabilityError("the flow is unstable; use a smaller cfl")

    def nothing(*_: Any, **__: Any) -> None:
        return None

    without_result = ((hazard_map, "_start_ahead"),)
    without_result += (work_precision, "run"), (work_precision, "report"), (verification, "command"), (stability_stress, "command")
    with contextlib.ExitStack() as patches:
        for place, name in without_result:
            patches.enter_context(mock.patch.object(place, name, nothing))
        for place in (runout, single):
            patches.enter_context(mock.patch.object(place, "simulate", simulate))
        patches.enter_context(mock.patch.object(doctor, "_devices", return_value=()))
        patches.enter_context(mock.patch.dict(os.environ))
        os.environ.pop("DISPLAY", None)
        yield

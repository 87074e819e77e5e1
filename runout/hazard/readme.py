"""``README.txt`` of a results folder: what each file is and what opens it, from what was written."""

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from runout import __version__
from runout.hazard.maps import GROUPS, map_layers
from runout.hazard.style import legend_unit
from runout.hazard.writers import Products
from runout.io.atomic import write_text
from runout.variables import VARIABLES

NAME = "README.txt"
WIDTH, INDENT = 110, 34
OTHERS = {  # files that are not hazard maps, where they are there; this run writes the report and run.json after this file
    "report.html": "the report for people: open it in a browser; it needs no network",
    "members.nc": "the maps of every member with its parameters and weight",
    "members/": "one file for each member: its maps and its mass, momentum and energy over time",
    "second_grid/": "the members on larger cells, from which the numerical error of each cell follows",
    "structures.nc": "forces and pressures on structures by facade",
    "probes/": "series at the probes: NetCDF, tables (CSV) and figures",
    "terrain.nc": "the elevation that the runs used",
    "release.nc": "the thickness of the releases",
    "run.json": "inputs, settings, versions and checksums: how these files came to be",
    "run.log": "messages of the runs",
}


def write_readme(products: Products, written: Mapping[str, Sequence[Path]]) -> Path:
    """Path of the file. ``written`` are the files of the formats by the docstrings of these."""
    return write_text("\n".join(_lines(products, written)) + "\n", products.results / NAME)


def _lines(products: Products, written: Mapping[str, Sequence[Path]]) -> Iterator[str]:
    attrs, results = products.hazard.attrs, products.results
    title = str(attrs.get("title", products.site.name))
    yield from (title, "=" * len(title), "")
    for statement in (f"Made by runout {__version__}. {attrs.get('ensemble', '')}.", _probabilities(attrs)):
        yield from textwrap.wrap(statement, WIDTH)
    yield ""
    yield from _entry("report.html", OTHERS["report.html"])
    for docstring, paths in sorted(written.items(), key=lambda part: "SITE" not in part[0]):  # what opens by itself comes first
        name, words = _described(docstring, products.site.name)
        yield from _entry(name, words if paths else f"not written. {words}")
        if name == "maps/":
            yield from _maps(products)
    for name, words in list(OTHERS.items())[1:]:
        if (results / name).exists() or name == "run.json":
            yield from _entry(name, words)


def _probabilities(attrs: Mapping[str, object]) -> str:
    """What probabilities suppose."""
    if "scenarios" in attrs:
        return f"Scenarios: {attrs['scenarios']}."
    return "Probabilities are conditional on the release and on the stated distributions. They are not annual probabilities."


def _described(docstring: str, site: str) -> tuple[str, str]:
    """File and words from the docstring of a format, ```name``: words``."""
    name, _, words = " ".join(docstring.split()).partition(": ")
    return name.strip("`").replace("SITE", site), re.sub("`+", "", words).replace("SITE", site).rstrip(".")


def _maps(products: Products) -> Iterator[str]:
    """The main maps one by one, and the folders of the others."""
    layers = list(map_layers(products.hazard))
    for layer in layers:
        if layer.path.count("/") == 1:
            unit = legend_unit(VARIABLES[layer.name].printed[0]).strip()
            yield from _entry(f"  {layer.stem}.tif", f"{layer.title}{f' [{unit}]' if unit else ''}")
    for group, title in GROUPS.items():
        count = sum(layer.path.startswith(f"maps/{group}/") for layer in layers)
        if count:
            yield from _entry(f"  {group}/", f"{title}: {count} {'map' if count == 1 else 'maps'}")


def _entry(name: str, words: str) -> Iterator[str]:
    """A name and its words, wrapped beside it."""
    lines = textwrap.wrap(words[:1].upper() + words[1:], WIDTH - INDENT)
    yield f"{name:<{INDENT - 1}} {lines[0]}"
    yield from (f"{'':<{INDENT}}{line}" for line in lines[1:])

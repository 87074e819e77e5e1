"""Why one would change a key of site.yaml, from reasons.yaml."""

from functools import cache
from importlib.resources import files

FILE = "reasons.yaml"


@cache
def reasons() -> dict[str, dict[str, str]]:
    """One line for each key, by block; keys of laws stand under the block that names the law, those of the top under ``site``."""
    from ruamel.yaml import YAML

    table: dict[str, dict[str, str]] = YAML(typ="safe", pure=True).load(files("runout.config").joinpath(FILE).read_text("utf-8"))
    return table


def reason(block: str, key: str) -> str:
    """Why one would change a key of a block; empty for keys of laws of other packages."""
    return reasons().get(block, {}).get(key, "")

"""Checksums of the sources of runout, which keys of members and stages hold: other code may give other results.

The version alone does not tell two states of a checkout apart. The contents count, not times and paths, so that the machines of a
cluster agree.
"""

import hashlib
from functools import cache
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parents[1]
# what draws, prints, aggregates or starts: no value in the file of a member depends on it
NOT_OF_MEMBERS = (
    *("commands", "hazard", "report", "scores", "slopes", "studies", "view", "workflow"),
    *("processes", "__main__.py", "cli.py", "log.py", "palettes.py", "safe_start.py"),
)


class Checksums(NamedTuple):
    """Checksums of the sources that members depend on, and of all, on which products depend."""

    members: str
    products: str


@cache
def checksums() -> Checksums:
    """Checksums of the sources of this package, computed once in a process."""
    return checksums_of(PACKAGE)


def checksums_of(package: Path) -> Checksums:
    """Checksums of the Python files in the folder of a package, in the order of their paths."""
    members, products = hashlib.sha256(), hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        place = file.relative_to(package)
        line = f"{place.as_posix()} {hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode()
        products.update(line)
        if place.parts[0] not in NOT_OF_MEMBERS:
            members.update(line)
    return Checksums(members.hexdigest(), products.hexdigest())

"""Published values of each process, from process_ranges.toml: settings of a new site.yaml, and ranges that its ensemble samples."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from runout.config.bed import BED, EROSION
from runout.config.bed import PREFIX as OF_EROSION
from runout.config.friction import ANGLE
from runout.config.friction import KEY as FRICTION
from runout.config.friction import PREFIX as OF_FRICTION
from runout.config.pore_pressure import KEY as PORE_PRESSURE
from runout.config.pore_pressure import PREFIX as OF_PORE_PRESSURE
from runout.errors import InputError

FILE = "process_ranges.toml"
BLOCKS = {  # of site.yaml that state a sampled parameter, by the first letters of its key
    OF_FRICTION: (FRICTION,),
    OF_PORE_PRESSURE: ("release", PORE_PRESSURE),
    OF_EROSION: (BED, EROSION),
    "bed_": (BED,),
}
CHECKED = {"primary": "checked", "secondary": "cited from another work", "memory": "cited from memory"}


@dataclass(frozen=True)
class PublishedRange:
    """Published values of a parameter that an ensemble may sample."""

    key: str  # of the parameter in ``ensemble.parameters``
    values: list[float]  # smallest, typical and largest value, or one value; in the unit of the parameter
    source: str  # publications, and what each states
    checked: str  # whether the numbers were checked in the source: a key of :data:`CHECKED`
    events: int | str = ""  # number of events or experiments behind the values; empty if it is not known

    @property
    def typical(self) -> float:
        """The typical value."""
        return self.values[len(self.values) // 2]

    @property
    def distribution(self) -> dict[str, Any] | None:
        """Uniform distribution over the range; None for one value."""
        if len(self.values) == 1:
            return None
        return {"distribution": "uniform", "low": float(self.values[0]), "high": float(self.values[-1])}

    @property
    def block(self) -> tuple[tuple[str, ...], str]:
        """Blocks of site.yaml that state the parameter, and its key there."""
        for prefix, blocks in BLOCKS.items():
            if self.key.startswith(prefix):
                return blocks, self.key.removeprefix(prefix)
        return ("material",), self.key

    def stated(self) -> str:
        """The key with its range, and the source."""
        return f"{self.key} {' to '.join(f'{value:g}' for value in sorted({self.values[0], self.values[-1]}))} ({self.source})"

    def words(self) -> str:
        """The source, with the number of its events and whether it was checked, and the value if there is one only."""
        value = "" if self.distribution else f"{self.key} {self.typical:g}: "
        events = f", events: {self.events}" if self.events else ""
        return f"{value}{self.source} ({CHECKED[self.checked]}{events})"


@dataclass(frozen=True)
class Variant:
    """Laws of a process, and the published ranges of their parameters."""

    settings: dict[str, Any]
    ranges: list[PublishedRange]

    def applied(self, site: Mapping[str, Any]) -> dict[str, Any]:
        """Settings of a site with those of the laws, the typical values, and the ranges as distributions."""
        made = _merged(site, self.settings)
        if FRICTION in self.settings:
            made.pop(ANGLE, None)
        made["ensemble"] = {
            **made.get("ensemble", {}),
            "parameters": {r.key: r.distribution for r in self.ranges if r.distribution},
        }
        for r in self.ranges:
            blocks, key = r.block
            value: Any = {key: float(r.typical)}
            for name in reversed(blocks):
                value = {name: value}
            made = _merged(made, value)
        return made


@dataclass(frozen=True)
class Process:
    """A process, its laws, and the pages of the validation that compare runout for it."""

    name: str
    title: str
    law: str
    compared: list[str]
    variant: Variant
    others: list[Variant]

    @property
    def of_friction(self) -> list[PublishedRange]:
        """Ranges of its basal friction, and of the pore pressure that lowers it."""
        return [r for r in self.variant.ranges if r.key.startswith((OF_FRICTION, OF_PORE_PRESSURE))]

    def applied(self, site: Mapping[str, Any], other: int | None = None) -> dict[str, Any]:
        """Settings of a site with those of the process; ``other`` is the number of another law or a part that is added."""
        note = f"Values published for other events ({self.title}), not calibrated to this site."
        if other is None:
            return self.variant.applied({**site, "description": note})
        added = self.others[other]
        replaced = {r.key for r in added.ranges} | {r.key for r in self.variant.ranges if r.block[0][0] in added.settings}
        ranges = [r for r in self.variant.ranges if r.key not in replaced] + added.ranges
        return Variant({**self.variant.settings, **added.settings}, ranges).applied({**site, "description": note})


def process_named(name: str) -> Process:
    """The process of a name.

    Raises InputError if there is no such process; the message names all.
    """
    if name not in processes():
        raise InputError(f"--process {name}: there is no such process; choose one of {', '.join(processes())}")
    return processes()[name]


@cache
def processes() -> dict[str, Process]:
    """All processes by their names."""
    content = tomllib.loads(files("runout.config").joinpath(FILE).read_text(encoding="utf-8"))
    return {name: _made(name, **block) for name, block in content.items()}


def published_friction(parameters: Mapping[str, Any]) -> tuple[str, list[PublishedRange]]:
    """Title of the process that publishes the most of these sampled ranges of friction and pore pressure, and these ranges."""
    known = {process.title: _equal_ranges(process, parameters) for process in processes().values()}
    title = max(known, key=lambda name: len(known[name]))
    return title, known[title]


def _equal_ranges(process: Process, parameters: Mapping[str, Any]) -> list[PublishedRange]:
    ranges = {r.key: r for variant in (*process.others, process.variant) for r in variant.ranges if r.distribution}
    of_friction = [r for key, r in ranges.items() if key.startswith((OF_FRICTION, OF_PORE_PRESSURE))]
    return [r for r in of_friction if parameters.get(r.key) == r.distribution]


def _made(name: str, title: str, law: str, compared: list[str], others: Any = (), **own: Any) -> Process:
    return Process(name, title, law, compared, _variant(**own), [_variant(**other) for other in others])


def _variant(settings: dict[str, Any], ranges: list[dict[str, Any]]) -> Variant:
    return Variant(settings, [PublishedRange(**r) for r in ranges])


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Nested settings, those of ``above`` in the place of those of ``below``; a block with a law replaces the whole block."""
    blocks = (k for k, v in above.items() if isinstance(v, dict) and isinstance(below.get(k), dict) and "law" not in v)
    return {**below, **above, **{k: _merged(below[k], above[k]) for k in blocks}}

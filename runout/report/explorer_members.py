"""Maps of the members for the explorer, on cells as coarse as their number asks for."""

import math
import zlib
from pathlib import Path

import numpy as np

from runout.ensemble.member import members_folder
from runout.io.member_maps import MemberMaps
from runout.quantities import ALL_QUANTITIES, ARRIVAL, CHANGE, UNTIL_ARRIVAL
from runout.report.explorer_layers import MEMBER_STEPS, STEPS, Family, Grid, bytes_of, legend_of, round_step
from runout.report.study import Study
from runout.report.wording import unit
from runout.variables import VARIABLES

SHOWN = ("max_flow_thickness", "max_speed", "max_pressure", ARRIVAL, "deposit_thickness", "eroded_depth", CHANGE)
BUDGET = 1_400_000  # bytes of all maps of the members, compressed
MOST_FINE = 50  # members whose values have as many steps as the products
SAMPLE = 8  # members from which the size of all is estimated


def member_families(study: Study, grid: Grid, products: list[Family]) -> tuple[list[Family], Grid]:
    """Families whose levels are the valid members, and their grid: the finest whose maps fit in :data:`BUDGET`."""
    numbers = [int(member) for member in study.valid.index]
    paths = [members_folder(study.results) / study.members["file"][number] for number in numbers]
    if not paths:
        return [], grid
    names = _held(paths[0])
    steps = STEPS if len(paths) <= MOST_FINE else MEMBER_STEPS
    some = paths[:: max(1, len(paths) // SAMPLE)]
    for _ in range(6):
        sampled = _families(study, names, _stacked(some, names, grid), numbers[: len(some)], steps)
        size = sum(len(zlib.compress(bytes_of(family.codes()), 6)) for family in sampled) * len(paths) / len(some)
        if size <= BUDGET:
            break
        grid = Grid(grid.window, max(grid.factor + 1, math.ceil(grid.factor * math.sqrt(size / BUDGET))))
    return _families(study, names, _stacked(paths, names, grid), numbers, steps), grid


def _held(path: Path) -> list[str]:
    with MemberMaps(path) as file:
        return [name for name in SHOWN if name in file.held()]


def _stacked(paths: list[Path], names: list[str], grid: Grid) -> dict[str, np.ndarray]:
    """Maps (members, rows, columns) by name, in units of files."""
    stacks = {name: np.empty((len(paths), *grid.shape), np.float32) for name in names}
    for k, path in enumerate(paths):
        with MemberMaps(path) as file:
            for name in names:
                stacks[name][k] = grid.reduce(file.within(name, grid.window), np.fmin if name in UNTIL_ARRIVAL else np.fmax)
    return stacks


def _families(study: Study, names: list[str], stacks: dict[str, np.ndarray], numbers: list[int], steps: int) -> list[Family]:
    found = []
    for name in names:
        units, divisor = VARIABLES[name].printed
        values = stacks[name] / np.float32(divisor)
        mapped = next((q for q in ALL_QUANTITIES.values() if q.member_map == name and not q.part_of), None)
        like = mapped.peak if mapped and mapped.peak in study.hazard else name
        words = mapped.words if mapped else VARIABLES[name].long_name
        largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
        found.append(
            Family(
                name, "One member", words[:1].upper() + words[1:], unit(units), "Member", [str(number) for number in numbers], values,
                legend_of(study.hazard, name, values, like), round_step(largest, steps),
            )
        )  # fmt: skip
    return found

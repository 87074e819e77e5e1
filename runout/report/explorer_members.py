"""Maps of the members for the explorer, on cells as coarse as their number asks for."""

import math
import zlib
from dataclasses import dataclass

import numpy as np

from runout.ensemble.member import members_folder
from runout.hazard.maps import classes_of
from runout.hazard.reach import representative
from runout.hazard.style import MapClasses, class_edges
from runout.io import netcdf
from runout.io.member_maps import MemberMaps, MembersFile
from runout.quantities import ALL_QUANTITIES, ARRIVAL, CHANGE, UNTIL_ARRIVAL
from runout.report.explorer_layers import MEMBER_STEPS, STEPS, Family, Grid, bytes_of, step_of
from runout.report.figures import parameter_label
from runout.report.study import Study
from runout.report.tables import sampled_parameters
from runout.report.wording import number, unit
from runout.variables import VARIABLES

SHOWN = ("max_flow_thickness", "max_speed", "max_pressure", ARRIVAL, "deposit_thickness", "eroded_depth", CHANGE)
SNAPSHOTS = {"flow_thickness": "max_flow_thickness", "speed": "max_speed"}  # of a file: map with the same classes
BUDGET = 1_500_000  # bytes of all maps of the members, compressed
MOST_FINE = 50  # members whose values have as many steps as the products
SAMPLE = 8  # members from which the size of all is estimated
TRIALS = 6


@dataclass(frozen=True)
class MemberLayers:
    """Maps of the members."""

    families: list[Family]  # levels are the valid members, or the snapshots of one
    grid: Grid  # the finest whose maps fit in :data:`BUDGET`
    parameters: list[str]  # sampled parameters of each valid member


def member_layers(study: Study, grid: Grid) -> MemberLayers:
    """Maps of the valid members on ``grid``, or on coarser cells where they are too many."""
    numbers = [int(member) for member in study.valid.index]
    if not numbers:
        return MemberLayers([], grid, [])
    steps = STEPS if len(numbers) <= MOST_FINE else MEMBER_STEPS
    some = numbers[:: max(1, len(numbers) // SAMPLE)]
    families: list[Family] = []
    with MembersFile(study.results / "members.nc") as stack:
        for _ in range(TRIALS):
            families = _families(study, stacked(stack, some, grid), some, steps)
            size = sum(len(zlib.compress(bytes_of(family.codes()), 6)) for family in families) * len(numbers) / len(some)
            if size <= BUDGET:
                break
            grid = Grid(grid.window, max(grid.factor + 1, math.ceil(grid.factor * math.sqrt(size / BUDGET))))
        else:
            families = []
        if len(some) < len(numbers) or not families:
            families = _families(study, stacked(stack, numbers, grid), numbers, steps)
    return MemberLayers([*families, *_snapshots(study, grid)], grid, [_parameters(study, member) for member in numbers])


def stacked(stack: MembersFile, numbers: list[int], grid: Grid) -> dict[str, np.ndarray]:
    """Maps (members, rows, columns) by name, in units of files."""
    of = {name: np.fmin if name in UNTIL_ARRIVAL else np.fmax for name in SHOWN if name in stack.maps}
    members = [stack.member(number) for number in numbers]
    return {
        name: np.stack([grid.reduce(member.within(name, grid.window), ufunc) for member in members]) for name, ufunc in of.items()
    }


def _families(study: Study, stacks: dict[str, np.ndarray], numbers: list[int], steps: int) -> list[Family]:
    levels = [str(member) for member in numbers]
    return [_family(study, name, "One member", f"Member: {_words(name)}", levels, values, steps) for name, values in stacks.items()]


def _family(study: Study, name: str, group: str, title: str, levels: list[str], values: np.ndarray, steps: int) -> Family:
    """A family with the classes that the largest of all members has."""
    alike = SNAPSHOTS.get(name, name)
    units, divisor = VARIABLES[alike].printed
    printed = values / np.float32(divisor)
    mapped = next((q for q in ALL_QUANTITIES.values() if q.member_map == alike and not q.part_of), None)
    finite = printed[np.isfinite(printed)]
    if mapped and mapped.peak in study.hazard:
        classes = classes_of(study.hazard, mapped.peak)
    else:
        smallest, largest = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        classes = MapClasses.of(class_edges(alike, [], smallest, largest), units, alike)
    choice = "Snapshot" if name in SNAPSHOTS else "Member"
    step = step_of(mapped.peak if mapped else alike, printed, classes, steps)
    return Family(name, group, title[:1].upper() + title[1:], unit(units), choice, levels, printed, classes, step)


def _words(name: str) -> str:
    mapped = next((q for q in ALL_QUANTITIES.values() if q.member_map == name and not q.part_of), None)
    return (f"maximum {mapped.words}" if mapped.formula else mapped.words) if mapped else VARIABLES[name].long_name


def _snapshots(study: Study, grid: Grid) -> list[Family]:
    """Thickness and speed of one member at the times that its file holds; none where the site keeps no snapshots."""
    member = representative(study.valid)
    path = members_folder(study.results) / study.members["file"][member]
    with MemberMaps(path) as file:
        if "snapshots" not in file.file.groups:
            return []
    rows, columns = grid.window
    dataset = netcdf.read(path, "snapshots")
    near = 0.1 * min(study.basemap.cell_size)
    whole = dataset.reindex(
        y=study.basemap.northing[rows], x=study.basemap.easting[columns], method="nearest", tolerance=near, fill_value=0.0
    )
    levels = [f"{number(float(time))} s" for time in dataset["time"].values]
    title = "{} at one time, member " + str(member)
    return [
        _family(study, name, "Snapshots of one member", title.format(words), levels, grid.reduce(whole[name].values), STEPS)
        for name, words in {"flow_thickness": "Flow thickness", "speed": "Flow speed"}.items()
        if name in whole
    ]


def _parameters(study: Study, member: int) -> str:
    names = sampled_parameters(study)
    return ", ".join(f"{parameter_label(name)}: {number(float(study.members.loc[member, name]))}" for name in names)

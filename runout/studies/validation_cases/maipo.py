"""Six mapped debris flows of the upper Maipo, Chile: run-out of each from parameters chosen by the other five.

Terrain, sources and outlines are those of the package runoptGPP (Goetz et al. 2021, Nat. Hazards Earth Syst. Sci. 21:2543). The
outlines hold path and deposit. No volume, thickness or speed was observed, so that the volume is a parameter of all events, and
parameters that differ may score alike. On a coarser grid, Voellmy friction is tried with and without an erodible bed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any

import numpy as np

import runout
from runout.io.polygons import read_frame
from runout.model.probes import ground_at
from runout.scores import Grid, Thalweg, contingency
from runout.scores.grid import outline_shares
from runout.slopes.drainage import drainage
from runout.studies.validation_cases.case import data_folder, on_all_processors

SOURCE = "the package runoptGPP, inst/extdata (github.com/jngtz/runoptGPP)"
DENSITY, INNER_FRICTION = 1900.0, 32.0  # [kg/m3], [deg]
THICKNESS = 4.0  # of the released mass [m]
VOLUMES = (1.0e4, 4.0e4)  # [m3]
CELL_SIZE, END = 8.0, 240.0  # [m], [s]
REACHED = 0.1  # thickness [m] from which a cell counts as reached
WALL = 1.0e4  # [m] by which the terrain beside an outline is raised to find the path within
BESIDE = 250.0  # [m]: cells farther from the path do not count for the length of the run-out
VOELLMY = tuple(product((0.1, 0.2, 0.3, 0.4), (50.0, 200.0, 800.0)))  # mu [1], xi [m/s2]
COARSE_CELL_SIZE = 12.5  # [m] of the runs with an erodible bed, and of those beside them
COARSE_VOELLMY = ((0.1, 800.0), (0.2, 800.0))  # mu [1], xi [m/s2]: the two that fit best on the finer grid
BED = 1.0  # depth of the bed [m]; this and the default law of erosion are those of `runout new --process debris_flow`
COARSE_VOLUME, BED_VOLUME = 4.0e4, 1.0e4  # [m3] of the releases on rigid ground, and on a bed that adds to them
WET = tuple(product((0.0, 0.1, 0.2, 0.3, 0.4, 0.5), (60.0, 300.0)))  # pore pressure ratio at the start [1], decay time [s]


@dataclass(frozen=True)
class Flow:
    """One mapped debris flow."""

    source: tuple[float, float]  # easting and northing [m] where it starts
    outline: Any
    # down the steepest of eight directions: within the outline from the source to its lowest cell, then on the terrain
    path: Thalweg
    reached: np.ndarray  # (rows, columns) of bool: cells of the terrain in the outline
    length: float  # along the path to the farthest cell of the outline [m]
    profile: np.ndarray  # (n, 2): length along the path [m] and elevation [m]

    @property
    def reach_slope(self) -> float:
        """Fall over length along the path [1], from the source to the end of the outline."""
        return float((self.profile[0, 1] - np.interp(self.length, *self.profile.T)) / self.length)

    def length_by_slope(self, slope: float) -> float:
        """Length along the path [m] at which a line from the source with a ``slope`` [1] meets the ground."""
        s, z = self.profile.T
        below = np.flatnonzero(z[0] - z <= slope * s)
        steep = below[below > np.argmax((z[0] - z) / np.maximum(s, s[1]))]
        return float(s[steep[0]] if len(steep) else s[-1])


@dataclass(frozen=True)
class Choice:
    """Parameters of a run: a volume [m3] and the numbers of a family, Voellmy or pore pressure."""

    family: str
    volume: float
    numbers: tuple[float, float]
    bed: float = 0.0  # depth [m]

    @property
    def told(self) -> str:
        """Sentence part."""
        a, b = self.numbers
        law = f"mu {a:g}, xi {b:g} m/s2" if self.family == "voellmy" else f"ratio {a:g}, decay time {b:g} s"
        return f"{law}, {self.volume:.0f} m3" + (f", bed of {self.bed:g} m" if self.bed else "")


CHOICES = {
    "voellmy": tuple(Choice("voellmy", volume, numbers) for volume, numbers in product(VOLUMES, VOELLMY)),
    "pore_pressure": tuple(Choice("pore_pressure", volume, numbers) for volume, numbers in product(VOLUMES, WET)),
}
COARSE_CHOICES = {
    "rigid": tuple(Choice("voellmy", COARSE_VOLUME, numbers) for numbers in COARSE_VOELLMY),
    "bed": tuple(Choice("voellmy", BED_VOLUME, numbers, BED) for numbers in COARSE_VOELLMY),
}


@dataclass(frozen=True)
class Event:
    """Terrain and flows."""

    terrain: runout.Terrain
    flows: tuple[Flow, ...]

    def simulated(self, flow: Flow, choice: Choice, cell_size: float = CELL_SIZE) -> runout.Result:
        """Run of one flow."""
        import shapely

        disc = shapely.Point(flow.source).buffer(float(np.sqrt(choice.volume / THICKNESS / np.pi)))
        share = outline_shares(disc, Grid.of(self.terrain))
        wet, law = None, runout.Coulomb(friction_angle=INNER_FRICTION)
        if choice.family == "voellmy":
            law = runout.Voellmy(mu=choice.numbers[0], xi=choice.numbers[1])
        else:
            wet = runout.PorePressure(ratio=choice.numbers[0], decay_time=choice.numbers[1])
        thickness = choice.volume * share / (share.sum() * self.terrain.cell_area)
        release = runout.Release.from_array(thickness, self.terrain, "on_surface", pore_pressure=wet)
        soil = runout.DruckerPrager(density=DENSITY, friction_angle=INNER_FRICTION)
        return runout.simulate(
            self.terrain, release, soil, basal_friction=law, bed=runout.Bed(choice.bed) if choice.bed else None,
            cell_size=cell_size, end_time=END, threads=1,
        )  # fmt: skip


def read() -> Event:
    """Terrain, sources, outlines and paths, from RUNOUT_DATA."""
    folder = data_folder("maipo_debrisflow_runoptGPP", SOURCE)
    terrain = runout.Terrain.from_raster(folder / "elev_12_5m.tif")
    grid = Grid.of(terrain)
    outlines = read_frame(folder / "dflow_runout_ply.shp", None, "outline")[0].geometry
    sources = read_frame(folder / "dflow_source_pnt.shp", None, "source")[0].geometry
    receiver = drainage(terrain).receiver.ravel()
    flows = []
    for point in sources:
        outline = outlines[int(outlines.distance(point).argmin())]
        covered = outline_shares(outline, grid)
        reached, path = covered >= 0.5, _path(terrain, receiver, covered > 0.0, (point.x, point.y))
        length, profile = _length(terrain, path, reached), np.column_stack([path.vertex_s, ground_at(terrain, path.points)])
        flows.append(Flow((point.x, point.y), outline, path, reached, length, profile))
    return Event(terrain, tuple(flows))


def _path(terrain: runout.Terrain, receiver: np.ndarray, inside: np.ndarray, source: tuple[float, float]) -> Thalweg:
    """The way of water from a place [m] to the lowest of the cells (rows, columns) inside of an outline, and on to the edge."""
    row = int(np.abs(terrain.northing - source[1]).argmin())
    column = int(np.abs(terrain.easting - source[0]).argmin())
    walled = runout.Terrain.from_array(terrain.elevation + WALL * ~inside, terrain.cell_size, crs=terrain.crs)
    lowest = int(np.where(inside, terrain.elevation, np.inf).argmin())
    cells: list[int] = []
    within, cell = drainage(walled).receiver.ravel(), row * terrain.shape[1] + column
    while not cells or cells[-1] != cell:
        cells.append(cell)
        if cell == lowest:
            within = receiver
        cell = int(within[cell])
    rows, columns = np.unravel_index(cells, terrain.shape)
    return Thalweg(np.column_stack([terrain.easting[columns], terrain.northing[rows]]))


def _length(terrain: runout.Terrain, path: Thalweg, reached: np.ndarray) -> float:
    """Length along a path [m] to the farthest of the cells (rows, columns) beside it that are reached."""
    rows, columns = np.nonzero(reached)
    s, aside = path.coordinates(terrain.easting[columns], terrain.northing[rows])
    near = np.abs(aside) <= BESIDE
    return float(s[near].max()) if near.any() else 0.0


def scored(event: Event, flow: Flow, choice: Choice, cell_size: float = CELL_SIZE) -> dict[str, float]:
    """Critical success index of the area [1], length of the run-out [m] and volume from the bed [m3] of one run."""
    result = event.simulated(flow, choice, cell_size)
    reached = np.nan_to_num(result.maps["max_flow_thickness"].values) >= REACHED
    table = contingency(reached, flow.reached, Grid.of(event.terrain).cell_area)
    entrained = float(result.ledger["entrained_mass"][-1]) / DENSITY if choice.bed else 0.0
    return {"csi": table.critical_success_index, "length": _length(event.terrain, flow.path, reached), "entrained": entrained}


def _score_of(job: tuple[int, Choice, float]) -> dict[str, float]:
    """Scores of one flow, by number, with one choice and cell size [m]; for a process of its own."""
    number, choice, cell_size = job
    event = _event()
    return scored(event, event.flows[number], choice, cell_size)


@cache
def _event() -> Event:
    return read()


def left_out(lengths: np.ndarray, csi: np.ndarray, observed: np.ndarray) -> list[dict[str, float]]:
    """For each flow the choice that the others prefer, and how it fares there.

    ``lengths``, ``csi`` (choices, flows): lengths of the run-out [m] and critical success indices [1] of all runs. ``observed``
    (flows,): observed lengths [m].
    """
    rows = []
    for flow in range(csi.shape[1]):
        others = np.arange(csi.shape[1]) != flow
        best = int(csi[:, others].mean(axis=1).argmax())
        rows.append(
            {
                "choice": best,
                "csi_of_others": float(csi[best, others].mean()),
                "csi": float(csi[best, flow]),
                "length": float(lengths[best, flow]),
                "length_error": float(lengths[best, flow] / observed[flow] - 1.0),
                "best_csi": float(csi[:, flow].max()),
            }
        )
    return rows


def by_reach_slope(flows: Sequence[Flow]) -> list[dict[str, float]]:
    """For each flow the length [m] that the mean slope of reach of the others gives (Heim 1932, Bergsturz und Menschenleben)."""
    slopes, rows = np.array([flow.reach_slope for flow in flows]), []
    for number, flow in enumerate(flows):
        mean = float(np.delete(slopes, number).mean())
        length = flow.length_by_slope(mean)
        rows.append({"slope": float(slopes[number]), "length": length, "length_error": length / flow.length - 1.0})
    return rows


def measure(full: bool) -> dict[str, Any]:
    """All choices for all flows; in CI one choice for one flow."""
    event = read()
    if not full:
        flow, choice = event.flows[-1], Choice("voellmy", 4.0e4, (0.2, 800.0))
        run = {"choice": choice.told, "observed_length": flow.length} | scored(event, flow, choice)
        return {"runs": [run], "lines": [f"  {choice.told}: CSI {run['csi']:.2f}, length {run['length']:.0f} m"]}
    observed = np.array([flow.length for flow in event.flows])
    results: dict[str, Any] = {"flows": [], "families": {}}
    for flow, row in zip(event.flows, by_reach_slope(event.flows), strict=True):
        area = float(flow.reached.sum() * event.terrain.cell_area)
        results["flows"].append({"length": flow.length, "area": area, "empirical": row})
    for family, choices in CHOICES.items():
        results["families"][family] = of_family(choices, observed, CELL_SIZE)
    results["coarse"] = coarse(observed)
    return results | {"lines": _lines(results)}


def coarse(observed: np.ndarray) -> dict[str, Any]:
    """Families with and without an erodible bed on the coarser grid; ``observed`` lengths [m] of the flows."""
    return {family: of_family(choices, observed, COARSE_CELL_SIZE) for family, choices in COARSE_CHOICES.items()}


def of_family(choices: Sequence[Choice], observed: np.ndarray, cell_size: float) -> dict[str, Any]:
    """Scores of choices for all flows, by the ``observed`` lengths [m], and the choices by leaving each flow out."""
    scores = on_all_processors(_score_of, [(flow, choice, cell_size) for choice in choices for flow in range(len(observed))])
    shape = len(choices), len(observed)
    csi, lengths, entrained = (np.array([one[key] for one in scores]).reshape(shape) for key in ("csi", "length", "entrained"))
    family = {"choices": [choice.told for choice in choices], "csi": csi.round(4).tolist(), "lengths": lengths.round(1).tolist()}
    if entrained.any():
        family["entrained"] = entrained.round(0).tolist()
    return family | {"left_out": left_out(lengths, csi, observed)}


def _lines(results: Mapping[str, Any]) -> list[str]:
    rows = []
    for family, family_results in (results["families"] | results["coarse"]).items():
        errors = [abs(row["length_error"]) for row in family_results["left_out"]]
        csi = [row["csi"] for row in family_results["left_out"]]
        rows.append(f"  {family}: left out, mean CSI {np.mean(csi):.2f}, mean error of the length {np.mean(errors):.2f}")
    errors = [abs(flow["empirical"]["length_error"]) for flow in results["flows"]]
    return [*rows, f"  mean slope of reach of the others: mean error of the length {np.mean(errors):.2f}"]

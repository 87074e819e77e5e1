"""Compares two products, or a product with an observation: on one grid, with scores and differences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ObservationError
from runout.io.member_maps import read_maps
from runout.model.terrain import Terrain
from runout.scores.assessment import (
    NO_BARS,
    Assessment,
    Setting,
    add_areas,
    add_arrivals,
    add_maps,
    against_observations,
    quantity_name,
    scores_of,
)
from runout.scores.elevation_change import change_errors
from runout.scores.energy_line import release_point
from runout.scores.flow import DEPTHS, UNITS, Flow
from runout.scores.grid import Grid, common_grid, outline_shares, placed, resampled
from runout.scores.members import Member, Probabilities, add_brier, ranked, scored_members, valid_members
from runout.scores.observations import Observations
from runout.scores.products import Product, Reading, VectorContent, member_product, read_product, read_vector
from runout.scores.read import Nodata, read_thalweg, where_dry
from runout.scores.slope_normal import slope_normal_thickness, terrain_slope

DEFAULT_THRESHOLDS = (0.1, 0.5, 1.0)
NO_AREA = ("change", "bed_share", "arrival")  # quantities without an area of a threshold
BOTH_ENSEMBLES = (
    "both are ensembles: compared are the percentiles of each cell, maps that no member has; name two members to compare flows"
)
NO_MEMBERS = (
    "{results}: the members of the ensemble are not there, so that only areas of its probability are scored; "
    "run `runout ensemble` for its site, or name a member"
)
NOTHING_IN_AREAS = (
    "the two share no area of a threshold; values of percentiles are those of no member: name a member, or state --threshold"
)


@dataclass(frozen=True)
class Choices:
    """Choices of a comparison.

    Attributes
    ----------
    quantity : str or None
        The one that is compared, and that a raster shows; by default all that both have. A raster shows what its
        name or unit says, else thickness.
    thresholds : sequence of float
        In the unit of the quantity; by default those of the site, else 0.1, 0.5 and 1 m.
    probability : float
        Outline of an ensemble [1].
    thalweg, dem : Path or None
        Line, and elevation raster where no product has one.
    half_width : float
        Largest distance [m] from the thalweg that counts.
    slope_normal : bool
        Rasters hold thickness normal to the slope, and so do the scores.
    nodata : str
        What cells of rasters without a value mean, "unknown" or "zero".
    layer : str or None
        Layer of the outline or points, where their file has several.
    """

    quantity: str | None = None
    thresholds: Sequence[float] = ()
    probability: float = 0.5
    thalweg: Path | None = None
    dem: Path | None = None
    half_width: float = float("inf")
    slope_normal: bool = False
    nodata: str = "unknown"
    layer: str | None = None

    def __post_init__(self) -> None:
        if self.quantity is not None and self.quantity not in UNITS:
            raise ObservationError(f"--quantity is {self.quantity!r}; choose one of {', '.join(UNITS)}")
        if not 0.0 < self.probability < 1.0:
            raise ObservationError(f"--probability is {self.probability:g}; it must be above 0 and below 1")
        wrong = [value for value in self.thresholds if not (np.isfinite(value) and value > 0)]
        if wrong:
            raise ObservationError(f"--threshold is {wrong[0]:g}; it must be above 0")
        if not self.half_width > 0:
            raise ObservationError(f"--half-width is {self.half_width:g} m; it must be above 0")


@dataclass(frozen=True)
class Comparison:
    """Result of a comparison.

    Attributes
    ----------
    a, b : Product
        Both products, on their own grids.
    grid : Grid
        Common cells.
    flows : tuple of Flow
        Maps of both on the common cells. An outline or points have no maps. If an ensemble is compared with one flow, its maps are
        those of its best member.
    elevation, release : ndarray (rows, columns) or None
        Elevation of the ground and thickness of the release [m], of the product that has them.
    vector : VectorContent or None
        Outline or points.
    assessment : Assessment
        Scores of ``a`` against ``b``. If an ensemble is compared with one flow, they score the area that a share of its members
        reaches.
    members : tuple of Member
        Members of the ensemble, from the best to the worst; empty unless one of the two is an ensemble with its members.
    ranked_by : str
        Score that ranks the members.
    thresholds : tuple of float
    changes : tuple of str
        Sentences on changes that the readers made.
    setting : Setting
    slope_normal : bool
        Whether thickness is normal to the slope.
    """

    a: Product
    b: Product
    grid: Grid
    flows: tuple[Flow, Flow]
    elevation: np.ndarray | None
    release: np.ndarray | None
    vector: VectorContent | None
    assessment: Assessment
    thresholds: tuple[float, ...]
    setting: Setting
    changes: tuple[str, ...] = field(default=())
    slope_normal: bool = False
    members: tuple[Member, ...] = ()
    ranked_by: str = ""

    @property
    def of_ensemble(self) -> int | None:
        """0 or 1 where the first or the second alone is an ensemble."""
        return _one_ensemble(self.a, self.b)

    @property
    def quantities(self) -> list[str]:
        """Quantities that both have as maps; those of percentiles differ from maps of one flow by what no member has."""
        if self.flows[0].is_percentile != self.flows[1].is_percentile:
            return []
        return [name for name in UNITS if all(name in flow.maps for flow in self.flows)]

    def difference(self, quantity: str) -> np.ndarray:
        """Map of the first minus that of the second (rows, columns); NaN where one is unknown, or one has no arrival."""
        one, other = (flow.maps[quantity] for flow in self.flows)
        with np.errstate(invalid="ignore"):
            difference = one - other
        return np.where(np.isfinite(difference), difference, np.nan)


def compare(first: Path, second: Path, choices: Choices) -> Comparison:
    """Compare a product with another one, or with an observation.

    Parameters
    ----------
    first : Path
        What is scored: results of a site, ``hazard.nc``, a member, the file of a run, or a raster.
    second : Path
        What it is scored against: one of these, an outline, or points with the attributes ``arrival_time``, ``thickness`` or
        ``speed``.

    Raises
    ------
    ObservationError
        If one of them cannot be read, they do not overlap, or have nothing in common.
    """
    reading = Reading(choices.quantity, choices.probability, Nodata(choices.nodata))
    a, b = read_product(first, reading), read_product(second, reading)
    choices = replace(choices, quantity=choices.quantity or _of_rasters(a, b))
    if a.flow is None:
        remedy = "exchange the two" if b.flow is not None else "name a product with maps"
        raise ObservationError(f"{a.path}: holds no maps, and the first of the two is the one that is scored; {remedy}")
    _require_metres(a.flow.grid)
    if b.flow is not None and choices.layer is not None:
        raise ObservationError(f"--layer {choices.layer}: {b.path} has maps, not layers; leave the option out")
    vector = None
    if b.flow is None:
        vector = read_vector(b.path, a.flow.grid.terrain(), choices.layer)
        grid = a.flow.grid if vector.outline is None else a.flow.grid.covering([vector.outline.bounds])
    else:
        grid = common_grid(a.flow.grid, b.flow.grid)
    changes = [*a.changes, *b.changes, *(vector.changes if vector else ())]
    if b.flow is not None:
        changes += placed(b.flow.grid, grid).sentences
    ground, release = _ground(a, b, grid, choices.dem)
    flows = _flows(a, b, grid, ground if choices.slope_normal else None, choices)
    setting, notes = _setting(a, b, grid, ground, release, choices)
    scored = _Scored(flows, Assessment())
    if _one_ensemble(a, b) is not None:
        scored = _by_members((a, b), flows, vector, setting, ground, choices)
    else:
        changes += [BOTH_ENSEMBLES] if a.kind == b.kind == "ensemble" else []
        scored.assessment = _assessed(flows, vector, setting, choices)
    notes = tuple(dict.fromkeys((*changes, *notes, *scored.notes)))
    return Comparison(
        a, b, grid, scored.flows, ground, release, vector, scored.assessment, tuple(setting.thresholds), setting, notes,
        choices.slope_normal, scored.members, scored.ranked_by,
    )  # fmt: skip


@dataclass
class _Scored:
    """What scoring gives: maps to show, scores, members from the best to the worst, and sentences."""

    flows: tuple[Flow, Flow]
    assessment: Assessment
    members: tuple[Member, ...] = ()
    ranked_by: str = ""
    notes: tuple[str, ...] = ()


def _one_ensemble(a: Product, b: Product) -> int | None:
    """Which of the two is an ensemble, if the other is none."""
    kinds = [one.kind == "ensemble" for one in (a, b)]
    return kinds.index(True) if sum(kinds) == 1 else None


def _by_members(
    products: tuple[Product, Product],
    flows: tuple[Flow, Flow],
    vector: VectorContent | None,
    setting: Setting,
    ground: np.ndarray | None,
    choices: Choices,
) -> _Scored:
    """Scores of the members of the one ensemble, and of the areas of its probability."""
    place = 0 if products[0].kind == "ensemble" else 1
    grid, results = flows[place].grid, products[place].path.parent
    members = valid_members(results)
    if not members:
        return _Scored(flows, _assessed(flows, vector, setting, choices), notes=(NO_MEMBERS.format(results=results),))
    probabilities = Probabilities()

    def pair(path: Path) -> tuple[Flow, Flow]:
        flow = _flow(member_product(path, read_maps(path)), grid, ground if choices.slope_normal else None, choices)
        flow = replace(flow, probability=choices.probability)
        return (flow, flows[1]) if place == 0 else (flows[0], flow)

    def assess(member: Member) -> Assessment:
        both = pair(member.path)
        probabilities.add(both[place], member.weight, _keys(both[place].maps, setting, choices))
        return _assessed(both, vector, setting, choices)

    scored, ranked_by = ranked(list(scored_members(members, assess)))
    whole = replace(flows[place], probabilities=probabilities.shares)
    both = (whole, flows[1]) if place == 0 else (flows[0], whole)
    assessment = _assessed(both, vector, setting, choices, may_be_empty=True)
    return _Scored(pair(scored[0].path), assessment, scored, ranked_by, tuple(probabilities.unlike_members(whole)))


def _keys(maps: Mapping[str, np.ndarray], setting: Setting, choices: Choices) -> list[tuple[str, float]]:
    """Quantities and thresholds whose areas are scored."""
    quantities = [name for name in maps if name in DEPTHS or (name == choices.quantity and name not in NO_AREA)]
    return [(name, threshold) for name in quantities for threshold in setting.thresholds]


def _of_rasters(*products: Product) -> str | None:
    """What the first raster among the products shows; None if there is none."""
    return next((name for one in products if one.kind == "raster" and one.flow for name in one.flow.maps), None)


def _require_metres(grid: Grid) -> None:
    """Raise ObservationError unless the grid is in metres: lengths and areas of scores are."""
    if grid.crs is None:
        return
    from pyproj import CRS

    system = CRS.from_user_input(grid.crs)
    if system.is_geographic or any(axis.unit_conversion_factor != 1.0 for axis in system.axis_info[:2]):
        raise ObservationError(
            f"{grid.source}: is in {system.name}, which is not in metres; scores are made in the system of the first of the two: "
            f"exchange them, or reproject it: gdalwarp -t_srs EPSG:CODE {grid.source} reprojected.tif"
        )


def _ground(a: Product, b: Product, grid: Grid, dem: Path | None) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Elevation and thickness of the release [m] on the common grid; None where no product has them."""
    source = next((one for one in (a, b) if one.elevation is not None), None)
    elevation = release = None
    if source is not None and source.flow is not None:
        elevation = resampled(np.asarray(source.elevation), source.flow.grid, grid)
        release = resampled(np.asarray(source.release), source.flow.grid, grid)
    if dem is not None:
        terrain = Terrain.from_raster(dem)
        elevation = resampled(terrain.elevation, Grid.of(terrain), grid)
    return elevation, release


def _flows(a: Product, b: Product, grid: Grid, ground: np.ndarray | None, choices: Choices) -> tuple[Flow, Flow]:
    """Maps of both on the common grid; thickness of runout normal to the slope where that is chosen."""
    return _flow(a, grid, ground, choices), _flow(b, grid, ground, choices)


def _flow(product: Product, grid: Grid, ground: np.ndarray | None, choices: Choices) -> Flow:
    flow = Flow(grid, {}) if product.flow is None else product.flow.on(grid)
    if product.kind == "raster" and choices.nodata == Nodata.ZERO:  # also beyond the raster
        flow = replace(flow, maps={name: where_dry(values, name) for name, values in flow.maps.items()})
    if choices.slope_normal and product.kind in ("ensemble", "member"):
        if ground is None:
            raise ObservationError("--slope-normal needs the elevation of the ground; name its raster with --dem")
        flow = _slope_normal(flow, terrain_slope(ground, grid.cell_size))
    return flow


def _slope_normal(flow: Flow, slope: np.ndarray) -> Flow:
    maps = {name: slope_normal_thickness(values, slope) if name in DEPTHS else values for name, values in flow.maps.items()}
    return replace(flow, maps=maps, probabilities={})


def _setting(
    a: Product, b: Product, grid: Grid, ground: np.ndarray | None, release: np.ndarray | None, choices: Choices
) -> tuple[Setting, tuple[str, ...]]:
    """Thresholds, thalweg, start of the energy line and error bars; sentences on changes to the thalweg."""
    of_site = next((one.thresholds for one in (a, b) if one.thresholds), DEFAULT_THRESHOLDS)
    thresholds = tuple(sorted(set(choices.thresholds))) or (of_site if choices.quantity in (None, *DEPTHS) else ())
    place = grid.terrain() if ground is None or not np.isfinite(ground).any() else replace(grid.terrain(), elevation=ground)
    thalweg, notes = read_thalweg(choices.thalweg, place) if choices.thalweg else (None, ())
    start = None
    if thalweg is not None and ground is not None and release is not None:
        start = release_point(grid.easting, grid.northing, ground, release)
    setting = Setting(thresholds, a.bars, thalweg, start, ground, choices.half_width)
    if choices.slope_normal:
        surface = None if ground is None else grid.cell_area / np.cos(terrain_slope(ground, grid.cell_size))
        setting = replace(setting, bars=NO_BARS, surface=surface, has_volume=surface is not None)
    return setting, notes


def _assessed(
    flows: tuple[Flow, Flow], vector: VectorContent | None, setting: Setting, choices: Choices, *, may_be_empty: bool = False
) -> Assessment:
    """Scores of the first flow against the second, or against an outline or points."""
    modelled, observed = flows
    assessment, grid = Assessment(), modelled.grid
    if vector is not None and vector.gauges is not None:
        assessment = against_observations(modelled, Observations(grid, gauges=vector.gauges), setting)
    elif vector is not None:
        quantity = _outlined(modelled.maps, choices)
        shares = outline_shares(vector.outline, grid)
        for threshold in setting.thresholds or DEFAULT_THRESHOLDS:
            of = f"outline, {quantity_name(quantity)} of {threshold:g} {UNITS[quantity]}"
            _add_areas(assessment, of, flows, shares, (quantity, threshold), setting)
    else:
        for quantity in _common(flows, choices):
            _add_quantity(assessment, modelled, observed, quantity, setting, choices)
    if not assessment.scores and not may_be_empty:
        raise ObservationError(NOTHING_IN_AREAS if any(flow.is_percentile for flow in flows) else "the two have nothing in common")
    return assessment


def _add_areas(
    assessment: Assessment, of: str, flows: tuple[Flow, Flow], shares: np.ndarray | None, key: tuple[str, float], setting: Setting
) -> None:
    """Scores of the area of a threshold against ``shares``, or that of the second flow; of an ensemble those of its probability."""
    place = next((k for k, flow in enumerate(flows) if flow.is_percentile), None)
    modelled, observed = flows[0].area(*key), flows[1].area(*key) if shares is None else shares
    if place is not None:
        of = f"{of} with P >= {flows[place].probability:g}"
    add_areas(assessment, of, flows[0].grid, modelled, observed, *key, setting)
    if place is not None and key in flows[place].probabilities:
        add_brier(assessment, of, flows[place].probabilities[key], modelled if place else observed)


def _outlined(maps: Mapping[str, np.ndarray], choices: Choices) -> str:
    quantity = choices.quantity or ("thickness" if "thickness" in maps else next(iter(maps)))
    if quantity not in maps or quantity in NO_AREA:
        usable = [name for name in maps if name not in NO_AREA]
        raise ObservationError(f"--quantity {quantity}: an outline scores one of {', '.join(usable) or 'none'} of the first")
    return quantity


def _common(flows: tuple[Flow, Flow], choices: Choices) -> list[str]:
    both = [name for name in UNITS if all(name in flow.maps for flow in flows)]
    chosen = [name for name in both if choices.quantity in (None, name)]
    if not chosen:
        quantities = " and ".join(f"[{', '.join(flow.maps) or 'none'}]" for flow in flows)
        missing = f"the quantity {choices.quantity}" if choices.quantity else "a quantity"
        raise ObservationError(f"the two do not share {missing}: they have {quantities}; choose one that both have with --quantity")
    known = [(~np.isnan(flows[0].maps[name]) & ~np.isnan(flows[1].maps[name])).any() for name in chosen]
    if not any(known):
        raise ObservationError(f"{chosen[0]}: no cell is known in both of the two; check nodata, or declare it dry: --nodata zero")
    return chosen


def _add_quantity(assessment: Assessment, a: Flow, b: Flow, quantity: str, setting: Setting, choices: Choices) -> None:
    if a.is_percentile != b.is_percentile:  # values of percentiles are those of no member
        for key in _keys({quantity: a.maps[quantity]}, setting, choices):
            _add_areas(assessment, f"{quantity_name(quantity)} of {key[1]:g} {UNITS[quantity]}", (a, b), None, key, setting)
    elif quantity == "arrival":
        add_arrivals(assessment, a, b, setting.bars)
    elif quantity == "change":
        limit = min(choices.thresholds, default=0.0)
        if a.is_percentile:  # percentiles have no volume
            return add_maps(assessment, a, b, quantity, replace(setting, thresholds=()))
        errors = change_errors(a.maps[quantity], b.maps[quantity], a.grid.cell_area, limit)
        scores = scores_of("change", "change of elevation", errors, "m", setting.bars.of_change(errors, limit))
        assessment.add("change of elevation", scores, unknown_cells=errors.change.unknown)
    else:
        own = quantity in DEPTHS or quantity == choices.quantity
        add_maps(assessment, a, b, quantity, setting if own else replace(setting, thresholds=()))


def summary(comparison: Comparison) -> dict[str, Any]:
    """Content of ``comparison.json``."""
    grid = comparison.grid
    return {
        "a": {"path": str(comparison.a.path), "kind": comparison.a.kind},
        "b": {"path": str(comparison.b.path), "kind": comparison.vector.kind if comparison.vector else comparison.b.kind},
        "grid": {"cell_size": list(grid.cell_size), "rows_columns": list(grid.shape), "extent": list(grid.extent)},
        "thresholds": list(comparison.thresholds),
        "probability": comparison.flows[0].probability,
        "thickness": "normal to the slope" if comparison.slope_normal else "vertical",
        "energy_line_from": "top of the release" if comparison.setting.start else None,
        "changes": list(comparison.changes),
        **comparison.assessment.stored(),
        **(
            {"ranked_by": comparison.ranked_by, "members": [one.stored() for one in comparison.members]}
            if comparison.members
            else {}
        ),
    }

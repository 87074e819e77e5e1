"""Keys, types, ranges and descriptions of site.yaml. The descriptions are also the comments of a new site.yaml."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PrivateAttr, SerializeAsAny, model_validator

from runout.config.bed import SETTINGS as BED
from runout.config.bed import BedSettings
from runout.config.design_table import DesignTable
from runout.config.distributions import Discrete, Distribution, Settings, limited, quantity, refuse
from runout.config.fetch import InputFile
from runout.config.friction import ANGLE, KEY, OF_RELEASE, FrictionSettings, OwnFriction, own_friction
from runout.config.friction import BLOCK as FRICTION_BLOCK
from runout.config.hazard import HazardSettings
from runout.config.inflow import SETTINGS as INFLOW
from runout.config.inflow import InflowSettings
from runout.config.material import (
    DEFAULT_LAW,
    MaterialSettings,
    OwnMaterial,
    sampled_parameters,
    sampled_ranges,
    validated_material,
)
from runout.config.observations import OBSERVATIONS, ObservationSettings
from runout.config.pore_pressure import PorePressureSettings
from runout.config.probes import PROBES, ProbeSettings
from runout.config.quantities import (
    CellSize,
    Degrees,
    Extent,
    FrictionAngle,
    FrictionFactor,
    Height,
    ParticlesPerCell,
    Text,
    Thickness,
)
from runout.config.release_start import START_TIME, START_VELOCITY, STARTS_WHEN, ArrivalSettings, Velocity
from runout.config.scenarios import FAILS, ScenarioSettings
from runout.config.stability import STABILITY, StabilitySettings
from runout.config.structures import STRUCTURES, StructureSettings
from runout.errors import ConfigError
from runout.model.friction_laws import DEFAULT_FRICTION
from runout.model.limits import CFL, PARTICLES_PER_CELL, SMALLEST_NET, spacing_of

SAMPLE_DEMS = ("matplotlib:jacksboro_fault_dem",)
MOST_MEMBERS, LARGEST_NET, MOST_SNAPSHOTS = 100_000, 65_536, 1000
SURFACES = (".obj", ".ply", ".stl")
LONGEST_TEXT = 500  # characters of a text of the metadata
NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"


ZoneFriction = Annotated[dict[str, float | str], BeforeValidator(own_friction(attributes=True))]


def zone_conflicts(block: Mapping[str, Any]) -> Iterator["Conflict"]:
    """Conflicts between keys of a friction zone."""
    keys = [key for key in ("factor", ANGLE, KEY) if key in block]
    if len(keys) != 1:
        said = f"{keys[0]} and {keys[1]} are both given" if keys else f"none of factor, {ANGLE} and {KEY} is given"
        yield "", said, f"give one of them: factor multiplies the friction of the mass, {ANGLE} or {KEY} replaces it"


def friction_conflicts(block: Mapping[str, Any]) -> Iterator["Conflict"]:
    """No basal friction, or two of them."""
    if {ANGLE, KEY} <= block.keys():
        yield KEY, f"{ANGLE} is given too", "remove one of the two"
    elif not {ANGLE, KEY} & block.keys():
        yield ANGLE, "required key is missing", f"add it: friction angle of the mass on the ground [deg]; or {KEY}: {{law: ...}}"


def mass_conflicts(block: Mapping[str, Any]) -> Iterator["Conflict"]:
    """Neither a release nor an inflow."""
    if not block.get("release") and not block.get("inflow"):
        message = "the list is empty" if "release" in block else "required key is missing"
        yield "release", message, "add it: a list of the masses that start to move; or inflow: [{line: ..., hydrograph: ...}]"


def terrain_conflicts(block: Mapping[str, Any]) -> Iterator["Conflict"]:
    """A key that only a mesh has beside a raster, or a mesh without its cells."""
    dem, key = block.get("dem"), "overhang_friction_angle_deg"
    is_mesh = isinstance(dem, str) and dem.lower().endswith(SURFACES)
    if is_mesh and "resolution" not in block:
        yield "resolution", "required key is missing for a mesh", "add resolution: the size of the cells that are made of it [m]"
    if key in block and not is_mesh:
        yield key, "has no meaning with a raster, which has no overhangs", "remove it, or give a mesh (OBJ, PLY, STL)"


class ZoneSettings(Settings):
    """Polygons with another basal friction."""

    polygons: str = quantity(
        "zones (GeoPackage, Shapefile, GeoJSON), relative to this folder", min_length=1, examples=["inputs/zones.gpkg"]
    )
    layer: str | None = quantity("layer of the GeoPackage; not needed when it has one only", None, examples=["forest"])
    factor: FrictionFactor | None = quantity(
        "multiplies the friction coefficient of the mass in these zones; a number or the attribute that holds it",
        None,
        examples=[1.5],
    )
    basal_friction_angle_deg: FrictionAngle | None = quantity(
        "replaces the friction angle of the mass in these zones; a number or the attribute that holds it",
        None,
        unit="deg",
        examples=[30.0],
    )

    basal_friction: ZoneFriction | None = quantity(
        "replaces these parameters of the law of friction in these zones; numbers or attributes that hold them",
        None,
        examples=[{"friction_angle_deg": 30.0}],
    )

    @model_validator(mode="after")
    def _complete(self) -> "ZoneSettings":
        _raise_first(zone_conflicts(self.model_dump(exclude_none=True)))
        return self


class ObstacleSettings(Settings):
    """Dams, walls and basins: ground that is higher or lower than in the elevation raster."""

    polygons: str = quantity(
        "outlines (GeoPackage, Shapefile, GeoJSON), relative to this folder", min_length=1, examples=["inputs/dams.gpkg"]
    )
    layer: str | None = quantity("layer of the GeoPackage; not needed when it has one only", None, examples=["dams"])
    height: Height = quantity(
        "how much the ground is raised inside the outlines, negative for a basin; a number or the attribute that holds it",
        unit="m",
        examples=[8.0],
    )


class TerrainSettings(Settings):
    """The terrain."""

    dem: InputFile = quantity(
        "elevation raster (GeoTIFF, ESRI ASCII, NetCDF) or surface mesh (OBJ, PLY, STL; with resolution), relative to this folder; "
        "or {url, sha256, size, path} of a public file"
    )
    crs: str | None = quantity(
        "coordinate reference system of a raster that states none", None, hint="for example EPSG:32632", examples=["EPSG:32632"]
    )
    extent: Extent | None = quantity(
        "part of the raster that is read, [west, south, east, north] in the coordinates of its file; by default all of it, or of a "
        "raster of more than 100 million cells what the releases can reach",
        None,
        examples=[[500000, 5000000, 510000, 5008000]],
    )
    resolution: float | None = limited(
        "resolution",
        "average the raster over whole blocks of cells to about this size, where it is much finer than the grid; cells of a mesh",
        None,
        examples=[10.0],
    )
    smoothing: float | None = limited(
        "smoothing", "average the elevations over a triangle of this half-width against survey artefacts", None, examples=[20.0]
    )
    overhang_friction_angle_deg: Degrees | None = limited(
        "basal_friction_angle", "friction angle of the overhangs of a mesh; by default that of the ground", None, examples=[30.0]
    )
    obstacles: list[ObstacleSettings] | None = quantity(
        "list of dams, walls and basins that the raster does not contain: polygons of a vector file, with the height by which they "
        "raise the ground",
        None,
        min_length=1,
        examples=[[{"polygons": "inputs/dams.gpkg", "height": 8.0}]],
    )
    friction_zones: list[ZoneSettings] | None = quantity(
        "list of zones with another basal friction (forest, bedrock, snow): polygons of a vector file, with "
        "factor, which multiplies the friction coefficients of the mass, or basal_friction_angle_deg, which replaces its angle, or "
        "basal_friction, which replaces parameters of its law",
        None,
        min_length=1,
        examples=[[{"polygons": "inputs/zones.gpkg", "factor": 1.5}]],
    )
    friction_rasters: dict[str, Text] | None = quantity(
        "parameters of the law of friction from rasters, {parameter: file}; cells without a value keep those of the mass",
        None,
        min_length=1,
        examples=[{"friction_angle_deg": "inputs/friction.tif"}],
    )

    @model_validator(mode="after")
    def _fits(self) -> "TerrainSettings":
        _raise_first(terrain_conflicts(self.model_dump(exclude_none=True)))
        return self


Conflict = tuple[str, str, str]  # key, what is wrong, remedy


def release_conflicts(block: Mapping[str, Any]) -> Iterator[Conflict]:
    """Conflicts between keys of a release."""
    polygons, raster = "polygons" in block, "raster" in block
    if polygons == raster:
        yield "", "polygons and raster are both given" if polygons else "neither polygons nor raster is given", "give one of them"
    elif polygons and not {"thickness", "volume"} & block.keys():
        yield "", "polygons without thickness and volume", "add thickness: [m] or volume: [m3]"
    elif unused := {"thickness", "edge", "layer"} & block.keys() if raster else {"sign"} & block.keys():
        for key in sorted(unused):
            yield key, f"has no meaning with {'a raster' if raster else 'polygons'}", "remove it"
    if {ANGLE, KEY} <= block.keys():
        yield KEY, f"{ANGLE} is given too", "remove one of the two"


def device_conflicts(block: Mapping[str, Any]) -> Iterator[Conflict]:
    """Conflicts of device with the backend."""
    device, backend = block.get("device", "cpu"), block.get("backend", "scan")
    if device != "cpu" and backend != "hash":
        yield "device", f"{device} with backend {backend}, which runs on the CPU only", "set device: cpu, or backend: hash"


def accuracy_conflicts(block: Mapping[str, Any]) -> Iterator[Conflict]:
    """Neither accuracy nor cell_size."""
    if "accuracy" not in block and "cell_size" not in block:
        yield "", "neither cell_size nor accuracy is given", "add cell_size: [m], or accuracy: standard"


def _raise_first(conflicts: Iterator[Conflict]) -> None:
    for key, message, fix in conflicts:
        raise refuse(message, fix, key)


class ReleaseSettings(Settings):
    """One mass that starts to move."""

    name: str = quantity("name of the release in messages and maps", "release", pattern=NAME, hint="letters, digits, - and _")
    polygons: str | None = quantity(
        "outline of the mass (GeoPackage, Shapefile, GeoJSON), relative to this folder; needs thickness or volume",
        None,
        min_length=1,
        examples=["inputs/release.gpkg"],
    )
    layer: str | None = quantity("layer of the GeoPackage; not needed when it has one only", None, examples=["release"])
    raster: InputFile | None = quantity(
        "instead of polygons: raster of vertical thickness in m, same forms as terrain.dem", None, examples=["inputs/thickness.tif"]
    )
    sign: Literal["positive", "negative"] | None = quantity(
        "negative: the raster states the failed thickness as a loss of elevation", None, examples=["negative"]
    )
    thickness: Thickness | None = quantity(
        "mean vertical thickness inside the polygons, or the name of the attribute that holds it", None, unit="m", examples=[10.0]
    )
    volume: float | None = limited(
        "volume", "volume of the mass: sets the thickness of the polygons, or is checked against it", None, examples=[100000.0]
    )
    placement: Literal["excavated", "on_surface"] = quantity(
        "excavated: the mass is part of the elevation raster, surveyed before it fails; on_surface: it lies on top of it, as snow, "
        "or on its sliding surface, surveyed after the event",
        "excavated",
    )
    edge: Literal["tapered", "vertical"] | None = quantity(
        "tapered: the mass thins out to its outline and keeps its volume; if excavated, its sliding surface leads out "
        "of the scar; vertical: the same thickness up to the outline, as of a slab of snow; default: tapered if excavated, "
        "vertical if on_surface",
        None,
        examples=["vertical"],
    )
    basal_friction_angle_deg: FrictionAngle | None = quantity(
        "friction angle under this mass only, where it slides on other ground than the rest, or the attribute of the polygons that "
        "holds it",
        None,
        unit="deg",
        examples=[15.0],
    )
    basal_friction: OwnFriction | None = quantity(
        "friction under this mass only: some parameters of the law of the site, or a law of its own with all of its parameters",
        None,
        examples=[{"law": DEFAULT_FRICTION, "friction_angle_deg": 15.0}],
    )
    material: OwnMaterial | None = quantity(
        "material of this mass only: some parameters of the law of the site, or a law of its own with all of its parameters",
        None,
        examples=[{"law": DEFAULT_LAW, "friction_angle_deg": 28.0}],
    )
    pore_pressure: PorePressureSettings | None = quantity(
        "water in this mass, which lowers its friction and drains while it flows: ratio, saturation, and diffusivity or decay_time",
        None,
        examples=[{"ratio": 0.7, "saturation": 1.0, "diffusivity": 1.0e-3}],
    )
    start_time: float | None = START_TIME
    velocity: Velocity | None = START_VELOCITY
    starts_when: ArrivalSettings | None = STARTS_WHEN

    @model_validator(mode="after")
    def _complete(self) -> "ReleaseSettings":
        _raise_first(release_conflicts(self.model_dump(exclude_none=True)))
        return self


class SimulationSettings(Settings):
    """How each member is computed."""

    accuracy: Literal["screening", "standard", "high"] | None = quantity(
        "screening, standard or high: sets cell_size from the thickness of the release, unless it is given; "
        "`runout check` prints the expected error and cost",
        None,
        examples=["standard"],
    )
    cell_size: CellSize | None = quantity(
        "grid spacing, one number or [east, north, up]; at most a quarter of the flow depth is recommended; half of it takes "
        "sixteen times the time",
        None,
        unit="m",
        examples=[10.0],
    )
    particles_per_cell: ParticlesPerCell | None = quantity(
        f"particles per cell, a number or [east, north, up]; by default {list(PARTICLES_PER_CELL)}, or [3, 3, 1] for a "
        "mass of five cells or more on level ground; fewer save memory",
        None,
        examples=[list(PARTICLES_PER_CELL)],
    )
    end_time: float = limited("end_time", "longest simulated time")
    stop_when_at_rest: bool = quantity("stop earlier when the mass has come to rest; false to follow creep", True)
    backend: Literal["scan", "hash", "reference"] = quantity("scan (CPU), hash (GPU) or reference (slow, for tests)", "scan")
    device: str = quantity("cpu, or cuda:0 for the first GPU", "cpu", pattern=r"^(cpu|cuda(:\d+)?)$", hint="cpu or cuda:0")
    threads: int | None = quantity(
        "threads of each member on the CPU; fewer leave cores to others [default: cores over members at once]", None, ge=1
    )
    precision: Literal["float32", "float64"] = quantity("float32, enough for maps, or float64, to check that", "float32")
    substeps: int = limited(
        "substeps", "most substeps of a transfer between particles and grid; 1 for a thin flow that leaves the ground", 4
    )
    initial_stress: Literal["at_rest", "none"] = quantity(
        "at_rest: releases start with the stress of their own weight; none: they start without stress, as a mass that falls",
        "at_rest",
    )
    cfl: float = limited("cfl", "time step as a fraction of the stable one; a smaller one is slower and not more accurate", CFL)
    arrival_threshold: float = limited(
        "arrival_threshold", "thickness that counts as arrival of the flow; raise it where thin fringes do not matter", 0.1
    )
    snapshots: int | None = quantity(
        "thickness and speed of every member are kept at this number of times, evenly spaced, for `runout view` and `animate`",
        None,
        ge=2,
        le=MOST_SNAPSHOTS,
        examples=[20],
    )

    @model_validator(mode="after")
    def _complete(self) -> "SimulationSettings":
        _raise_first(accuracy_conflicts(self.model_dump(exclude_none=True)))
        _raise_first(device_conflicts(self.model_dump()))
        return self

    def on_device(self, device: str) -> "SimulationSettings":
        """The settings with another device: "cpu", "cuda:N", "cuda" or "auto" (GPUs if there are any, else the CPU).

        Raises DeviceError if there is no such device; the message lists the devices of the machine.
        """
        from runout.backends.protocol import find_device

        first_device = find_device(device)
        place = "cuda" if device == "cuda" or (device == "auto" and first_device != "cpu") else first_device
        backend = "hash" if place != "cpu" else "scan" if self.backend == "hash" else self.backend
        return self.model_copy(update={"device": place, "backend": backend})

    def with_cell_size(self, cell_size: Sequence[float]) -> "SimulationSettings":
        """The settings with another grid spacing [m], one number or three; ConfigError if it is out of range."""
        east, north, up = spacing_of(tuple(cell_size))  # type: ignore[arg-type]
        return self.model_copy(update={"cell_size": east if len(cell_size) == 1 else [east, north, up]})


class EnsembleSettings(Settings):
    """The members."""

    members: int = quantity(
        "number of members, of each scenario if there are some; powers of 2 cover the parameters evenly; with tolerance the "
        "largest number",
        1,
        ge=1,
        le=MOST_MEMBERS,
    )
    tolerance: float | None = quantity(
        "largest sampling error of the probabilities (exceedance_rms_error of every threshold): the members double from "
        f"{SMALLEST_NET} until it is reached, to members at most",
        None,
        gt=0,
        le=0.2,
        hint="it is a probability: 0.02 for 2 %",
        examples=[0.02],
    )
    seed: int = quantity(
        "seed of the sampling; the same seed gives the same members, another one shows what depends on the sample",
        0,
        ge=0,
        le=2**31 - 1,
    )
    parameters: Annotated[dict[str, Distribution], BeforeValidator(sampled_parameters)] = quantity(
        f"sampled parameters: {', '.join(sampled_ranges())} (those that the laws of material, friction and erosion have); "
        "of one release alone as RELEASE.parameter, also RELEASE.start_time and RELEASE.start_speed; "
        "each uniform {low, high}, normal {mean, standard_deviation, low, high}, "
        "triangular {low, mode, high} or discrete {values, frequencies}",
        {},
    )
    scenarios: Annotated[list[ScenarioSettings], Field(min_length=1)] | None = quantity(
        "classes of events with their annual rates, each with own members: name, one of return_period, annual_rate, "
        "exceedance_return_period and power_law, and releases, parameters, members where they differ",
        None,
        examples=[[{"name": "rare", "return_period": 300.0, "parameters": {"release_volume_factor": 2.0}}]],
    )
    table: str | None = quantity(
        "instead of members, parameters and scenarios: table (CSV) with a row a member; columns are parameters, weight, "
        "annual_rate, scenario and seed",
        None,
        min_length=1,
        examples=["inputs/members.csv"],
    )
    _rows: DesignTable | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _can_grow(self) -> "EnsembleSettings":
        if self.table is None:
            _raise_first(growth_conflicts(self.tolerance, self.members, list(self.parameters)))
        _raise_first(table_conflicts(self))
        return self

    def with_rows(self, rows: DesignTable) -> "EnsembleSettings":
        """The settings with the members that the table holds."""
        settings = self.model_copy()
        settings._rows = rows
        return settings

    @property
    def rows(self) -> DesignTable | None:
        """Members of the table; None without a table.

        Raises ConfigError if the table was not read: :func:`runout.config.read.load` does that.
        """
        if self.table is not None and self._rows is None:
            raise ConfigError(f"ensemble.table: {self.table} was not read; read the site with runout.config.site.read_site")
        return self._rows

    @property
    def size(self) -> int:
        """Number of members of all scenarios, or of the table."""
        if self.table is not None:
            return self.rows.size  # type: ignore[union-attr]
        return sum(one.members or self.members for one in self.scenarios) if self.scenarios else self.members

    @property
    def has_rates(self) -> bool:
        """Whether the members have annual rates."""
        return bool(self.scenarios) or (self.rows is not None and "annual_rate" in self.rows.columns)

    @property
    def fail_apart(self) -> bool:
        """Whether the scenario of a member, or its row in the table, says which releases fail."""
        columns = self.rows.parameters if self.rows is not None else {}
        return any(one.releases for one in self.scenarios or ()) or any(name.endswith(OF_RELEASE + FAILS) for name in columns)

    def sampled(self) -> list[dict[str, Distribution]]:
        """Distributions of the parameters of each scenario, or of all members; of a table the values of each column."""
        if self.scenarios:
            return [{**self.parameters, **one.parameters} for one in self.scenarios]
        return [dict(self.parameters)] if self.rows is None else _values_of(self.rows)


def _values_of(rows: DesignTable) -> list[dict[str, Distribution]]:
    """Values of the columns of a table as distributions: all of them, and those that state a value for every member."""
    columns = {name: [value for value in values if value == value] for name, values in rows.parameters.items()}
    every: dict[str, Distribution] = {name: _discrete(values) for name, values in columns.items() if values}
    return [every, {name: one for name, one in every.items() if len(columns[name]) == rows.size}]


def _discrete(values: list[float]) -> Discrete:
    distinct = sorted(set(values))
    return Discrete(distribution="discrete", values=distinct, frequencies=[1.0] * len(distinct))


def table_conflicts(ensemble: "EnsembleSettings") -> Iterator[Conflict]:
    """Keys of the ensemble that have no meaning with a table of members."""
    if ensemble.table is not None:
        for key in ("members", "tolerance", "parameters", "scenarios"):
            if key in ensemble.model_fields_set and getattr(ensemble, key) is not None:
                yield key, "the table states the members", "remove it, or the table"


def growth_conflicts(tolerance: float | None, members: int, parameters: list[str]) -> Iterator[Conflict]:
    """Conflicts of tolerance with the other keys of the ensemble."""
    if tolerance is None:
        return
    if members < SMALLEST_NET or members & (members - 1):
        fits = min(max(SMALLEST_NET, 2 ** members.bit_length()), LARGEST_NET)
        yield "members", f"{members} with tolerance, where it is a power of two from {SMALLEST_NET} on", f"set it to {fits}"
    elif not parameters:
        yield "tolerance", "no parameters are sampled, so that members differ by their seeds only", "remove it, or add parameters"


class BudgetSettings(Settings):
    """A run that is forecast to need more is refused."""

    hours: float | None = quantity("wall-clock time of the run", None, unit="h", gt=0, examples=[1.0])
    memory_gb: float | None = quantity(
        "memory of the run, so that the machine does not swap", None, unit="GB", gt=0, examples=[8.0]
    )
    disk_gb: float | None = quantity("disk that the results take", None, unit="GB", gt=0, examples=[2.0])


def _text(description: str, **bounds: str) -> str | None:
    return quantity(description, None, min_length=1, max_length=LONGEST_TEXT, **bounds)  # type: ignore[no-any-return]


class MetadataSettings(Settings):
    """Author and purpose of the study. All keys are optional; the products contain only those that are stated."""

    author: str | None = _text("who is responsible for the study")
    email: str | None = _text("address of the author", pattern=r"^[^@\s]+@[^@\s]+$", hint="name@example.org")
    url: str | None = _text("page of the author, for example an ORCID", pattern=r"^https?://", hint="begin with https://")
    institution: str | None = _text("where the study was made")
    project: str | None = _text("project that it belongs to")
    purpose: str | None = _text("what the maps are for, and what not")
    license: str | None = _text("licence of the products, for example CC-BY-4.0")
    references: str | None = _text("reports and papers that describe the case")
    acknowledgement: str | None = _text("who is to be named as the source of the inputs")


class ReportSettings(Settings):
    """What the report shows besides maps and tables."""

    stills: Literal["none", "worst", "all"] = quantity(
        "3D pictures of the maximum thickness: none, of the member with the longest runout (worst), or of every member (all); they "
        "need the extra runout[view] and OpenGL, and take about two seconds each",
        "none",
    )
    orthophoto: str | None = quantity(
        "picture of the ground for the interactive map, a georeferenced raster with one band or three, relative to this folder",
        None,
        min_length=1,
        examples=["inputs/orthophoto.tif"],
    )


class SiteSettings(Settings):
    """A whole site.yaml."""

    name: str = quantity("short name of the site", pattern=NAME, hint="letters, digits, - and _")
    title: str = quantity("title of maps and report", "")
    description: str = quantity("what is modelled, and what is hypothetical", "")
    metadata: MetadataSettings | None = quantity(
        "who made the study and what for: author, email, url, institution, project, purpose, license, references, acknowledgement",
        None,
        examples=[{"author": "A. Name", "institution": "Survey", "purpose": "screening"}],
    )
    terrain: TerrainSettings = quantity("the terrain")
    structures: list[StructureSettings] | None = STRUCTURES
    release: list[ReleaseSettings] = quantity("the masses that start to move, a list; none where an inflow is all there is", [])
    inflow: list[InflowSettings] | None = INFLOW
    material: Annotated[SerializeAsAny[MaterialSettings], BeforeValidator(validated_material)] = quantity("the material")
    basal_friction_angle_deg: Degrees | None = limited(
        "basal_friction_angle", "friction angle of the mass on the ground", None, examples=[20.0]
    )
    basal_friction: Annotated[SerializeAsAny[FrictionSettings], BeforeValidator(FRICTION_BLOCK.validated)] | None = quantity(
        "instead of basal_friction_angle_deg: law of friction of the mass on the ground and its parameters",
        None,
        examples=[{"law": DEFAULT_FRICTION, "friction_angle_deg": 20.0}],
    )
    bed: BedSettings | None = BED
    bulking: float | None = limited(
        "bulking", "volume of the deposit over that of its mass: multiplies the thickness of deposits", None, examples=[0.9]
    )
    simulation: SimulationSettings = quantity("how each member is computed")
    ensemble: EnsembleSettings = quantity("the members", EnsembleSettings())
    hazard: HazardSettings = quantity("what the maps show", HazardSettings())
    probes: ProbeSettings | None = PROBES
    stability: StabilitySettings | None = STABILITY
    observations: ObservationSettings | None = OBSERVATIONS
    report: ReportSettings | None = quantity(
        "what the report shows besides maps and tables: stills none, worst or all; orthophoto", None, examples=[{"stills": "worst"}]
    )
    budget: BudgetSettings | None = quantity(
        "a run that is forecast to need more is refused", None, examples=[{"hours": 1.0, "memory_gb": 8.0, "disk_gb": 2.0}]
    )

    @model_validator(mode="after")
    def _one_friction(self) -> "SiteSettings":
        _raise_first(friction_conflicts(self.model_dump(include={ANGLE, KEY}, exclude_none=True)))
        return self

    @model_validator(mode="after")
    def _some_mass(self) -> "SiteSettings":
        _raise_first(mass_conflicts({name: getattr(self, name) for name in ("release", "inflow") if name in self.model_fields_set}))
        return self

"""Table of all variables that runout writes: name -> unit, long name, CF standard name, type, valid range.

Files are described from this table alone; the names of map quantities come from :mod:`runout.quantities`. A standard name is
given only where the CF table has one; there is none for debris, deposit, impact pressure or arrival, and none is borrowed from
floods.
"""

from dataclasses import dataclass, replace

from runout.quantities import (
    ALL_QUANTITIES,
    ARRIVAL,
    ARRIVAL_PERCENTILE,
    CHANGE,
    CHANGE_PERCENTILE,
    ERODED,
    FIRST_ARRIVAL,
    MET,
    QUANTITIES,
    SHARE,
    MapQuantity,
)

FILL = -9999.0
PRINTED = {"Pa": ("kPa", 1000.0), "year-1": ("1/a", 1.0), "year": ("a", 1.0)}  # unit in files -> printed unit and divisor
FILL_BY_DTYPE = {"float32": FILL, "float64": None, "int16": -9999, "int32": -9999, "int64": None, "uint8": 255, "str": None}


@dataclass(frozen=True)
class Variable:
    """Description of a variable in a file."""

    units: str  # UDUNITS unit; "1" for a pure number, "" for text
    long_name: str  # name for people, as in a legend
    standard_name: str | None = None  # name of the CF table, only where one exists
    dtype: str = "float32"  # type in files; maps are float32, with -9999 where there is no value
    # valid_min, valid_max: range of the values; what lies outside is read as missing by a GIS
    valid_min: float | None = None
    valid_max: float | None = None
    # CF cell methods: how a value stands for its cell. Extremes over time or members are told by the long name, for these are no
    # coordinates of a map
    cell_methods: str | None = None
    comment: str | None = None  # what a reader has to know to use the values
    content: str = "modelResult"  # ACDD's `coverage_content_type`: what kind of content it is

    @property
    def fill(self) -> float | int | None:
        """Value that marks missing data; None if data cannot be missing."""
        return FILL_BY_DTYPE[self.dtype]

    @property
    def printed(self) -> tuple[str, float]:
        """Printed unit, and the divisor from :attr:`units` to it."""
        return PRINTED.get(self.units, (self.units, 1.0))

    def attributes(self) -> dict[str, str]:
        """Text attributes of the variable in a file."""
        named = {
            "units": self.units,
            "long_name": self.long_name,
            "standard_name": self.standard_name,
            "cell_methods": self.cell_methods,
            "comment": self.comment,
            "coverage_content_type": self.content,
        }
        return {key: text for key, text in named.items() if text}


def _positive(units: str, long_name: str, comment: str | None = None) -> Variable:
    return Variable(units, long_name, valid_min=0.0, comment=comment)


def _double(units: str, long_name: str, comment: str | None = None) -> Variable:
    return Variable(units, long_name, dtype="float64", comment=comment)


def _share(long_name: str, comment: str | None = None) -> Variable:
    return Variable("1", long_name, valid_min=0.0, valid_max=1.0, comment=comment)


def _text(long_name: str) -> Variable:
    return Variable("", long_name, dtype="str")


def _count(long_name: str, comment: str | None = None) -> Variable:
    return Variable("1", long_name, dtype="int32", valid_min=0, comment=comment)


_JOINTLY = "a member reaches all thresholds of the joint condition, those of the flow at one time"
_FRACTION = "fraction of the ensemble's weight, given that the release happens; not an annual probability"

_MEMBER_MAPS = {
    **{q.member_map: _positive(q.units, f"maximum {q.described}" if q.formula else q.described) for q in QUANTITIES.values()},
    ARRIVAL: _positive("s", "time from the release to the arrival of the flow", comment="missing where no flow arrives"),
    "eroded_depth": _positive("m", "depth by which the flow lowered the ground, vertical"),
    "elevation_change": Variable("m", "change of elevation", comment="after the runout minus before the failure"),
    "bed_share": _share("share of the erodible bed in the mass of the deposit", "missing without deposit"),
    MET: _positive(
        "1", "joint conditions met at one time", comment="sum of 2**k where condition k of the attribute joint_conditions is met"
    ),
    "flow_thickness": _positive("m", "flow thickness, vertical"),
    "speed": _positive("m s-1", "speed of the flow"),
    "particle_easting": _double("m", "easting of a particle"),
    "particle_northing": _double("m", "northing of a particle"),
    "particle_elevation": Variable("m", "elevation of a particle"),
    "particle_speed": Variable("m s-1", "speed of a particle"),
}

_TERRAIN_MAPS = {
    "elevation": Variable("m", "ground elevation", "surface_altitude", cell_methods="area: mean"),
    "elevation_known": Variable("1", "whether the cell has an elevation (1) or not (0)", dtype="uint8", valid_min=0, valid_max=1),
    "ground_slope": Variable("degree", "slope of the ground", "ground_slope_angle", valid_min=0.0, valid_max=90.0),
    "release_thickness": _positive("m", "thickness of the release, vertical", comment="before any sampled factor"),
    "inflow_thickness": _positive(
        "m", "thickness of the inflows, vertical", comment="largest at their lines, on a strip of two cells"
    ),
}


GRID_ERROR = "of the grid alone, from a second grid of larger cells: a bar that holds 9 of 10 cells"


def _exceedance(name: str, condition: str, cells: str) -> dict[str, Variable]:
    """Probability that a condition holds and its standard errors; ``cells`` says which ones count for the mean error."""
    return {
        f"{name}_exceedance_probability": _share(f"conditional probability that {condition}", _FRACTION),
        f"{name}_exceedance_standard_error": _share(
            f"standard error of the conditional probability that {condition}",
            "sampling error alone; the attribute estimator has its formula. Of blocks: three degrees of freedom in a cell; "
            "0 where all blocks agree",
        ),
        f"{name}_exceedance_numerical_error": _share(
            f"numerical error of the conditional probability that {condition}", GRID_ERROR
        ),
        f"{name}_exceedance_rms_error": Variable(
            "1",
            f"mean standard error of the probability that {condition}",
            dtype="float64",
            valid_min=0.0,
            comment=f"root mean square over the cells {cells}",
        ),
    }


def _annual(name: str, condition: str) -> dict[str, Variable]:
    return {
        f"{name}_annual_exceedance": _positive(
            "year-1",
            f"annual rate at which {condition}",
            comment="expected events in a year, all scenarios together; probability of one or more in a year: 1 - exp(-rate)",
        )
    }


def _over_members(q: MapQuantity) -> dict[str, Variable]:
    """Maps over the members of a quantity."""
    variables = _exceedance(q.name, f"the {q.extreme} reaches or exceeds the threshold", "that any member reaches at the threshold")
    if q.percentile:
        variables[q.percentile] = _positive(q.units, f"percentile over the members of the {q.extreme}")
    variables[q.peak] = _positive(q.units, f"largest {q.words} of any member")
    if q.mean:
        mean = f"mean over the members of the {q.extreme}"
        variables[q.mean] = _positive(q.units, f"weighted {mean}")
        variables[q.deviation] = _positive(
            q.units, f"standard deviation over the members of the {q.extreme}", "what the sampled parameters leave open; by weight"
        )
        variables[q.standard_error] = _positive(
            q.units, f"standard error of the {mean}", "what the number of members leaves open; estimated as that of probabilities"
        )
        variables[q.numerical_error] = _positive(q.units, f"numerical error of the {mean}", GRID_ERROR)
    variables |= _annual(q.name, f"the {q.extreme} reaches or exceeds the threshold")
    if q.at_return_period:
        comment = "largest value that is reached at an annual rate of 1 / return period; missing where the flow arrives less often"
        variables[q.at_return_period] = _positive(q.units, f"{q.extreme} at the return period", comment)
    return variables


_HAZARD_MAPS = {
    "inundation_probability": _share(
        "conditional probability that the maximum flow thickness reaches or exceeds the lowest threshold", _FRACTION
    ),
    **{name: variable for q in ALL_QUANTITIES.values() for name, variable in _over_members(q).items()},
    **_exceedance("joint", _JOINTLY, "where any member meets the condition"),
    **_annual("joint", _JOINTLY),
    FIRST_ARRIVAL: _positive("s", "earliest arrival of any member", comment="missing where no member arrives"),
    ARRIVAL_PERCENTILE: _positive(
        "s",
        "percentile over the members of the arrival time",
        comment="members that do not arrive count as infinity; missing where those that arrive weigh less than the percentile",
    ),
    "members_reached": _count(
        "number of valid members that inundate the cell", "maximum flow thickness of at least the lowest threshold"
    ),
}

_BOUNDARY = {
    "boundary_distance_mean": Variable(
        "m", "mean over the members of the signed distance to the boundary of the flow, positive inside",
        comment="by weight; only where 5 % to 95 % of the weight arrives; 0 is the mean position of the boundary",
    ),
    "boundary_distance_deviation": _positive(
        "m", "standard deviation over the members of the distance to the boundary of the flow",
        "by weight; only where 5 % to 95 % of the weight arrives; the position of the boundary varies by that",
    ),
}  # fmt: skip

_MERGED = {
    "source_probability": Variable(
        "1", "conditional probability that the maximum flow thickness of a source reaches or exceeds the lowest threshold",
        valid_min=0.0, valid_max=1.0, comment=_FRACTION,
    ),
    "main_source": Variable(
        "1", "number of the source that reaches the cell with the largest probability", dtype="int16", valid_min=0,
        comment="0 where no source arrives; source_name holds the names",
    ),
    "sources_reached": Variable("1", "number of the sources that reach the cell", dtype="int16", valid_min=0),
}  # fmt: skip

_DECIDING = {
    "deciding_error": Variable(
        "1", "largest of three errors of the mean over the members of the maximum flow thickness", dtype="uint8",
        comment="each as a bar that holds 9 of 10 cases; 0: no member arrives",
    )
}  # fmt: skip

_DANGER = {
    "intensity_class": Variable(
        "1", "strongest class of intensity that is reached at the return period or more often", dtype="uint8",
        comment="annual, over all scenarios of the site; the attribute checked states how each class was verified",
    ),
    "danger_level": Variable(
        "1", "level of danger: highest of the matrix of intensity and return period", dtype="uint8",
        comment="annual, over all scenarios of the site; the attribute checked states how each level was verified",
    ),
    "class_annual_exceedance": Variable(
        "year-1", "annual rate at which the class of intensity or a stronger one is reached", valid_min=0.0,
        comment="over all scenarios of the site; the classes at return periods follow from it",
    ),
}  # fmt: skip

_SURVEYED = "of the surveyed cells; negative where the ground was lowered; changes below the detection limit count as 0"
_OBSERVED = {
    "observed_deposit_thickness": _positive("m", "observed thickness of the deposit, vertical", "missing where unknown"),
    "observed_elevation_change": Variable("m", "observed change of elevation", comment="missing where unknown"),
    "mean_elevation_change": Variable(
        "m", "weighted mean over the members of the change of elevation", comment="deposit minus released mass and eroded depth"
    ),
    "reach_start": _double("m", "upper end of the reach, along the thalweg"),
    "reach_end": _double("m", "lower end of the reach, along the thalweg"),
    "reach_volume": _double("m3", "net change of volume of the ground in the reach", _SURVEYED),
    "observed_reach_volume": _double("m3", "observed net change of volume of the ground in the reach", _SURVEYED),
}

_OF_A_BED = {
    CHANGE_PERCENTILE: Variable(
        "m", "percentile over the members of the change of elevation", comment="after the runout minus before the failure"
    ),
    "mean_bed_share": _share(
        "share of the erodible bed in the mean deposit of the members",
        "shares of the members, weighted by their deposit; missing where none has a deposit",
    ),
}  # fmt: skip

_SLOPES = {
    "sink_depth": _positive("m", "depth below the spill of a closed sink of the elevation raster"),
    "drainage_area": _positive("m2", "plan area that drains through the cell", comment="along the steepest of eight directions"),
    "factor_of_safety": _positive("1", "median factor of safety of an infinite slope", comment="at most 10"),
    "failure_probability": _share("share of the samples in which an infinite slope fails", "not an annual probability"),
    "failure_thickness": _positive("m", "mean vertical thickness of the samples that fail", comment="0 where none fails"),
}

_DIFFERENCES = {
    name: Variable(units, f"difference of the {what}", comment="modelled minus observed, or first minus second product")
    for name, units, what in (
        *((q.difference, q.units, q.extreme) for q in QUANTITIES.values()),
        (f"{ARRIVAL}_difference", "s", "arrival time"),
        (f"{CHANGE}_difference", "m", "change of elevation"),
        (f"{ERODED}_difference", "m", "depth of the bed that the flow took up"),
        (f"{SHARE}_difference", "1", "share of the erodible bed in the deposit"),
    )
}

_REACHED = "cells in which the flow is at any time as thick as the lowest threshold"
_ENSEMBLE = {
    "members_planned": _count("number of planned members"),
    "members_valid": _count("number of valid members, on which every map rests"),
    "members_failed": _count("number of members that failed"),
    "members_missing": _count("number of members that have not run"),
    "effective_sample_size": _double("1", "effective number of members, 1 / sum of squared weights"),
    "weight": Variable("1", "weight of the member, of a sum of 1 over all planned members", dtype="float64", valid_min=0.0),
    "annual_rate": Variable(
        "year-1", "annual rate of the member, its share of that of its scenario", dtype="float64", valid_min=0.0
    ),
    "scenario": _text("name of the scenario of the member"),
    "fails": _double("1", "whether it fails (1) or not (0)"),
    "seed": Variable("1", "seed of the member's random numbers", dtype="int64"),
    "file": _text("name of the member's file in members/"),
    "status": _text("valid, failed or missing"),
    "failure_reason": _text("why the member failed"),
    "runout_distance": _double("m", "plan distance from the release to the farthest cell that the flow reaches", _REACHED),
    "reach_angle_deg": _double("degree", "slope of the line from the highest released cell to that farthest cell"),
    "reached_area": _double("km2", "area of all cells that the flow reaches", _REACHED),
    "highest_speed": _double("m s-1", "largest of the map of maximum speed"),
    "deposit_volume": _double("m3", "volume that lies outside the release area at the end"),
    "escaped_fraction": _double("percent", "share of the mass that left the elevation raster"),
    "end_time": _double("s", "time at which the run stopped"),
    "released_volume": _double("m3", "volume of the releases and inflows"),
    "eroded_volume": _double("m3", "volume of the bed that the flow took up"),
    "whole_deposit_volume": _double("m3", "volume of the deposit on the raster at the end"),
    "left_volume": _double("m3", "volume of the mass that left the elevation raster"),
    "lowered_volume": _double("m3", "volume by which the ground is lower than before the failure"),
    "raised_volume": _double("m3", "volume by which the ground is higher than before the failure"),
    "basal_friction_angle_deg": _double("degree", "basal friction angle"),
    "friction_angle_deg": _double("degree", "internal friction angle"),
    "cohesion": _double("Pa", "cohesion"),
    "density": _double("kg m-3", "bulk density"),
    "youngs_modulus": _double("Pa", "Young's modulus"),
    "pore_pressure_ratio": _double("1", "pore pressure over total normal stress at the start"),
    "pore_pressure_ratio_low": _double("1", "smallest pore pressure ratio at the start"),
    "pore_pressure_ratio_high": _double("1", "largest pore pressure ratio at the start"),
    "pore_pressure_ratio_elsewhere": _double("1", "pore pressure ratio at the start beyond all zones"),
    "pore_pressure_saturation": _double("1", "share of the thickness of the release that stands in water"),
    "pore_pressure_diffusivity": _double("m2 s-1", "diffusivity of pore pressure"),
    "pore_pressure_decay_time": _double("s", "time in which excess pore pressure falls to 1/e"),
    "release_volume_factor": _double("1", "factor on the thickness of the release"),
    "bed_depth_factor": _double("1", "factor on the depth of the erodible bed"),
    "bed_density": _double("kg m-3", "density of the erodible bed"),
    "bed_pore_pressure_ratio": _double("1", "pore pressure over total normal stress in the erodible bed"),
    "discharge_factor": _double("1", "factor on the discharge of the inflows"),
    "inflow_delay": _double("s", "time that is added to the hydrographs of the inflows"),
    "bulking": _double("1", "volume of the deposit over that of its mass"),
}

_COORDINATES = {
    **{q.threshold: Variable(q.units, f"threshold of the {q.extreme}", dtype="float64") for q in ALL_QUANTITIES.values()},
    "source": Variable("1", "number of the source", dtype="int32"),
    "source_name": Variable("", "name of the source", dtype="str"),
    "joint": Variable("1", "number of the joint condition", dtype="int32"),
    "joint_condition": _text("joint condition in words"),
    **{
        q.joint_threshold: Variable(
            q.units, f"threshold of the {q.extreme} in a joint condition", dtype="float64", comment="missing if it has none"
        )
        for q in ALL_QUANTITIES.values()
    },
    "percentile": _double("percent", "percentile over the members, by weight"),
    "class_number": Variable("1", "number of the class of intensity, from the weakest", dtype="int32"),
    "class_return_period": _double("year", "return period of the classes of intensity"),
    "return_period": _double("year", "return period"),
    "realization": Variable("1", "number of the ensemble member", "realization", dtype="int32"),
    "time": _double("s", "time since the release"),
}

_LEDGER = {
    "mass": _double("kg", "moving and resting mass inside the domain"),
    "escaped_mass": _double("kg", "mass that left the domain"),
    "entrained_mass": _double("kg", "mass that the flow took up from an erodible bed"),
    "entrained_energy": _double("J", "energy of the mass taken up from the bed, where it lay"),
    "entered_mass": _double("kg", "mass that entered after the start, of releases that start later and other sources"),
    "entered_energy": _double("J", "energy of that mass where it entered, kinetic, potential and elastic"),
    "waiting_mass": _double("kg", "mass of releases that have not started", comment="at the end: never released"),
    "entrainment_dissipation": _double("J", "energy dissipated to bring mass of the bed to the speed of the flow"),
    "kinetic_energy": _double("J", "kinetic energy"),
    "potential_energy": _double("J", "potential energy above the local origin"),
    "elastic_energy": _double("J", "elastic energy"),
    "escaped_energy": _double("J", "energy of the mass that left the domain"),
    "dissipation": _double("J", "energy dissipated at the ground, at structures and by plastic flow"),
    "basal_dissipation": _double("J", "energy dissipated by friction at the ground"),
    "structure_dissipation": _double("J", "energy dissipated by friction and impact at structures"),
    "plastic_dissipation": _double("J", "energy dissipated by plastic flow"),
    "numerical_dissipation": _double("J", "energy lost by the numerical scheme", "the remainder that closes the energy balance"),
    "momentum_x": _double("kg m s-1", "momentum towards the east"),
    "momentum_y": _double("kg m s-1", "momentum towards the north"),
    "momentum_z": _double("kg m s-1", "momentum upwards"),
    "active_blocks": Variable("1", "number of active blocks of the grid", dtype="int64", comment="4 x 4 x 4 nodes with particles"),
    "active_nodes": Variable("1", "number of nodes of the active blocks", dtype="int64"),
    "sparsity": _double(
        "1", "nodes of the bounding box over active nodes", "of the smallest box of blocks that holds all active blocks"
    ),
    "memory": Variable(
        "byte",
        "memory of the particles and the grid",
        dtype="int64",
        comment="allocated by the backend, on the device if it has one; of all members that share a launch; depends on threads",
    ),
    "contact_particles": Variable("1", "number of particles in contact with the ground", dtype="int64"),
    "dt": _double("s", "time step"),
}


_AXES = {"east": "towards the east", "north": "towards the north", "up": "upwards"}
_STRUCTURES = {
    "structure_name": _text("name of the structure"),
    "facade_name": _text("name of the facade"),
    "facade_area": _double("m2", "area of the facade above the ground"),
    "record_time": _double("s", "end of the interval, since the release"),
    **{f"facade_force_{axis}": Variable("N", f"force of the flow on the facade {way}") for axis, way in _AXES.items()},
    **{
        f"facade_moment_{axis}": Variable("N m", f"moment of the flow on the facade about the foot of the structure, axis {way}")
        for axis, way in _AXES.items()
    },
    "facade_pressure": Variable("Pa", "mean pressure on the facade", comment="by area, mean over the interval"),
    "facade_high_pressure": Variable("Pa", "pressure that 95 % of the area of the facade does not exceed"),
    "max_facade_force": _positive("N", "maximum over time of the force on the facade"),
    "max_facade_moment": _positive("N m", "maximum over time of the moment on the facade about the foot of the structure"),
    "max_facade_pressure": Variable("Pa", "maximum over time of the mean pressure on the facade"),
    "max_facade_high_pressure": Variable("Pa", "maximum over time of the pressure that 95 % of the facade does not exceed"),
    "time_of_max_facade_force": _positive("s", "time of the maximum force on the facade", "missing where no flow reaches it"),
    "facade_force_at_percentile": _positive("N", "percentile over the members of the maximum force on the facade"),
    "facade_moment_at_percentile": _positive("N m", "percentile over the members of the maximum moment on the facade"),
    "facade_pressure_at_percentile": Variable("Pa", "percentile over the members of the maximum mean pressure on the facade"),
    "facade_high_pressure_at_percentile": Variable("Pa", "percentile over the members of the maximum 95 % pressure on the facade"),
    "facade_pressure_probability": _share(
        "conditional probability that the maximum mean pressure on the facade reaches or exceeds the threshold", _FRACTION
    ),
    "protected_area": _text("area behind a dam"),
    "overtopping_volume": _positive("m3", "volume that lies in the protected area at the end"),
    "overtopping_volume_at_percentile": _positive("m3", "percentile over the members of the overtopping volume"),
    "overtopping_probability": _share("conditional probability that mass reaches the protected area and stays there", _FRACTION),
}


_PROBES = {
    **{q.stem: _positive(q.units, q.described) for q in ALL_QUANTITIES.values() if q.formula},
    "discharge": Variable(
        "m3 s-1",
        "discharge through the cross-section",
        comment="mean over the interval that ends at this time; positive to the left of the line, its lower side",
    ),
    "passed_volume": Variable("m3", "volume that has passed the cross-section", comment="the integral of the discharge"),
    "flow_width": _positive("m", "length of the cross-section that the flow covers", "at least as thick as the arrival threshold"),
    "largest_thickness": _positive("m", "largest flow thickness along the cross-section, vertical"),
    "max_discharge": _positive("m3 s-1", "maximum discharge through the cross-section", "mean over one interval of the series"),
    "arrival_probability": _share("conditional probability that the flow arrives", _FRACTION),
    "bed_elevation": Variable(
        "m", "elevation of the ground without the released mass", comment="the surface on which flow and deposit lie"
    ),
    "ground_elevation": Variable("m", "ground elevation, bilinear between the cell centres", "surface_altitude"),
}

_STATIONS = {
    "station_name": _text("name"),
    "station_elevation": Variable("m", "ground elevation", "surface_altitude", dtype="float64"),
    "section_length": _double("m", "length of the cross-section in the plan"),
    "distance": _double("m", "length along the line from its first vertex"),
}


def _of(content: str, variables: dict[str, Variable]) -> dict[str, Variable]:
    return {name: replace(variable, content=content) for name, variable in variables.items()}


VARIABLES: dict[str, Variable] = {
    **_MEMBER_MAPS,
    **_of("referenceInformation", _TERRAIN_MAPS),
    **_HAZARD_MAPS,
    **_of("qualityInformation", {name: v for name, v in _HAZARD_MAPS.items() if name.endswith("_error")}),
    **_OBSERVED,
    **_OF_A_BED,
    **_DANGER,
    **_DECIDING,
    **_MERGED,
    **_BOUNDARY,
    **_SLOPES,
    **_DIFFERENCES,
    **_of("auxiliaryInformation", _ENSEMBLE),
    **_of("coordinate", _COORDINATES),
    **_LEDGER,
    **_STRUCTURES,
    **_PROBES,
    **_of("coordinate", _STATIONS),
}

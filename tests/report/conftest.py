"""A small results folder as the stages before the report leave it: a valley, eight members of which one failed."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import shapely
import xarray as xr

from runout.hazard.figures import member_figures
from runout.hazard.joint import with_conditions
from runout.hazard.reach import Reach
from runout.io import netcdf
from runout.io.member_maps import MembersFile, member_table
from runout.quantities import QUANTITIES

ROWS, COLUMNS, CELL = 130, 150, 20.0
WEST, SOUTH = 735000.0, 4040000.0
FRICTION = np.linspace(12.0, 22.0, 8)
FAILED = 5
CHANGES = ["rows were turned to north up"]
METADATA = {"author": "A. Name", "institution": "A survey", "purpose": "screening <of> a road"}
RESOLUTION = {"depth": 30.0, "cells_through_depth": 1.5, "numerical_viscosity": 4.0, "shear_decay_time": 0.15}
DAM = shapely.box(WEST + 1400.0, SOUTH + 1000.0, WEST + 1700.0, SOUTH + 1060.0)
ZONES = [
    shapely.box(WEST + 900.0, SOUTH + 1300.0, WEST + 1300.0, SOUTH + 1600.0),
    shapely.box(WEST + 1600.0, SOUTH + 1300.0, WEST + 2000.0, SOUTH + 1600.0),
]
SETTINGS = {
    "name": "valley",
    "title": "Invented valley <test>",
    "description": "The release is hypothetical.",
    "terrain": {"dem": "inputs/dem.tif"},
    "release": [{"name": "scar", "polygons": "inputs/release.gpkg", "thickness": 15.0, "placement": "excavated"}],
    "material": {"law": "drucker_prager", "density": 2000, "youngs_modulus": 5e6},
    "simulation": {"cell_size": 4.0, "end_time": 90, "stop_when_at_rest": True},
    "ensemble": {"members": 8, "parameters": {"basal_friction_angle_deg": {"distribution": "uniform", "low": 12, "high": 22}}},
}
REASON = "StabilityError: speed 950 m/s at step 12; lower simulation.cfl"


def valley():
    """Easting, northing and elevation of a slope with a channel that falls to the south."""
    x = WEST + (np.arange(COLUMNS) + 0.5) * CELL
    y = SOUTH + (ROWS - 0.5 - np.arange(ROWS)) * CELL
    east, north = np.meshgrid(x - x.mean(), y - y.min())
    bend = 160 * np.sin(north / 320)
    return x, y, 300 + 0.42 * north + 90 * (1 - np.exp(-(((east - bend) / 260) ** 2))) + 6 * np.sin(east / 90) * np.cos(north / 70)


def flow(x, y, friction_deg):
    """Thickness [m], speed [m/s] and arrival [s] of an invented flow down the channel."""
    east, north = np.meshgrid(x - x.mean(), y - y.min())
    across = (east - 160 * np.sin(north / 320)) / (70 + 20 * np.sin(north / 150))
    length = 1250 - 40 * (friction_deg - 12)
    along = (2000 - north) / length
    inside = (np.abs(across) < 1) & (along > 0) & (along < 1)
    thickness = np.where(inside, 18 * (1 - across**2) * (1 - 0.7 * along), 0.0)
    speed = np.where(inside, 34 * np.sqrt(np.maximum(1 - across**2, 0)) * np.sin(np.pi * np.clip(along, 0.06, 1)), 0.0)
    return thickness, speed, np.where(inside, 42 * np.abs(along) ** 1.3, np.nan)


def ledger(friction_deg):
    """Ledger of a run whose energy balance closes."""
    t = np.linspace(0, 90, 60)
    released = 4e12 * (1 - np.exp(-((t / 35) ** 2)))
    kinetic = 0.35 * 4e12 * (t / 25) ** 2 * np.exp(1 - (t / 25) ** 2) * (22 / friction_deg) ** 0.5 * 0.8
    kinetic = np.minimum(kinetic, 0.8 * released)
    rest = released - kinetic
    series = {
        "mass": np.full_like(t, 3e9),
        "escaped_mass": np.zeros_like(t),
        "kinetic_energy": kinetic,
        "potential_energy": 9e12 - released,
        "elastic_energy": np.full_like(t, 1e9),
        "basal_dissipation": 0.7 * rest,
        "plastic_dissipation": 0.295 * rest,
        "numerical_dissipation": 0.005 * rest,
    }
    return xr.Dataset({k: ("time", v) for k, v in series.items()}, coords={"time": t})


def write_members(folder, maps):
    """Member files with maps at the root and the ledger as a group."""
    folder.mkdir(parents=True)
    for member, (thickness, speed, arrival) in maps.items():
        path = folder / f"{member:04d}.nc"
        values = {"max_flow_thickness": thickness, "max_speed": speed, "arrival_time": arrival}
        values["deposit_thickness"] = 0.4 * thickness
        xr.Dataset({k: (("y", "x"), v.astype("f4")) for k, v in values.items()}).to_netcdf(path)
        ledger(FRICTION[member]).to_netcdf(path, mode="a", group="ledger")


def write_members_file(path, maps):
    """``members.nc``: the table of members, their maps, and their ledgers one behind another."""
    status = ["failed" if m == FAILED else "valid" for m in range(8)]
    columns = {
        "weight": np.full(8, 0.125),
        "seed": np.arange(8),
        "file": np.array([f"{m:04d}.nc" for m in range(8)], dtype=object),
        "status": np.array(status, dtype=object),
        "failure_reason": np.array([REASON if s == "failed" else "" for s in status], dtype=object),
        "basal_friction_angle_deg": FRICTION,
        "release_volume_factor": np.tile([0.5, 1.0], 4),
    }
    table = xr.Dataset({k: ("realization", v) for k, v in columns.items()}, coords={"realization": np.arange(8, dtype="i4")})
    for k, name in enumerate(("max_flow_thickness", "max_speed", "arrival_time")):
        table[name] = (("realization", "y", "x"), np.stack([maps.get(m, np.full((3, ROWS, COLUMNS), np.nan))[k] for m in range(8)]))
    table["deposit_thickness"] = 0.4 * table["max_flow_thickness"]
    table.to_netcdf(path)
    ledgers = {m: ledger(FRICTION[m]) for m in maps}
    lengths = [ledgers[m].sizes["time"] if m in ledgers else 0 for m in range(8)]
    names = ("time", *ledgers[0].data_vars)
    records = {name: ("record", np.concatenate([one[name].values for one in ledgers.values()])) for name in names}
    records["records"] = ("realization", np.array(lengths, "i4"))
    xr.Dataset(records).to_netcdf(path, mode="a", group="ledgers")


def write_figures(path):
    """Figures of the valid members in a ``members.nc``, as the hazard stage takes them from its maps and ledgers."""
    reach = Reach.of(hazard := netcdf.read(path.with_name("hazard.nc")))
    least, table = float(hazard["thickness_threshold"].min()), member_table(path)
    valid = table.index[table["status"] == "valid"]
    with MembersFile(path) as stack:
        figures = {m: member_figures(stack.member(m), stack.member(m).ledger(), reach, least) for m in valid}
    columns = pd.DataFrame.from_dict(figures, orient="index").reindex(table.index)
    xr.Dataset({name: ("realization", values) for name, values in columns.items()}).to_netcdf(path, mode="a")


def add_exceedance(hazard, name, dimension, reached):
    """Probability and errors of members (limits, members, rows, columns) of bool that reach limits."""
    p = reached.mean(axis=1)
    error = np.sqrt(p * (1 - p) / reached.shape[1])
    hazard[f"{name}_exceedance_probability"] = ((dimension, "y", "x"), p)
    hazard[f"{name}_exceedance_standard_error"] = ((dimension, "y", "x"), error)
    means = np.sqrt([np.mean(e[q > 0] ** 2) for e, q in zip(error, p, strict=True)])
    hazard[f"{name}_exceedance_rms_error"] = (dimension, means)


def hazard_dataset(maps):
    """``hazard.nc`` of the members."""
    x, y, z = valley()
    thickness, speed, arrival = (np.stack([m[i] for m in maps.values()]) for i in range(3))
    pressure, flux = 2000.0 * speed**2, 0.7 * thickness * speed**2
    hazard = xr.Dataset(coords={"x": x, "y": y, "percentile": [5.0, 50.0, 95.0]})
    hazard["crs"] = ((), np.int32(0), {"long_name": "coordinate reference system: WGS 84 / UTM zone 16N"})
    hazard["elevation"] = (("y", "x"), z)
    hazard["release_thickness"] = (("y", "x"), release_thickness(x, y))
    stacks = {"thickness": (thickness, [0.1, 0.5, 2.0]), "speed": (speed, [1.0, 5.0]), "pressure": (pressure, [3e3, 3e4])}
    stacks |= {"momentum_flux": (flux, [10.0]), "deposit": (0.4 * thickness, [1.0])}
    added = [q for q in QUANTITIES.values() if q.name not in stacks]
    stacks |= {q.name: (np.vectorize(q.formula, otypes=[float])(0.7 * thickness, speed, 2000.0), q.thresholds) for q in added}
    for name, (values, levels) in stacks.items():
        if levels:
            hazard[f"{name}_threshold"] = list(levels)
            add_exceedance(hazard, name, f"{name}_threshold", np.stack([values > level for level in levels]))
        quantity = QUANTITIES[name]
        hazard[quantity.percentile] = (("percentile", "y", "x"), np.percentile(values, [5, 50, 95], axis=0))
        hazard[quantity.peak] = (("y", "x"), values.max(axis=0))
    hazard = with_conditions(hazard, [{"thickness": 2.0, "speed": 5.0}])
    add_exceedance(hazard, "joint", "joint", ((thickness > 2) & (speed > 5))[None])
    hazard["arrival_time_percentile"] = (("percentile", "y", "x"), np.nanpercentile(arrival, [5, 50, 95], axis=0))
    hazard["inundation_probability"] = (("y", "x"), (thickness > 0.1).mean(axis=0))
    hazard["members_reached"] = (("y", "x"), (thickness > 0.1).sum(axis=0))
    hazard["mean_deposit_thickness"] = (("y", "x"), 0.4 * thickness.mean(axis=0))
    hazard["first_arrival_time"] = (("y", "x"), np.fmin.reduce(arrival))
    return hazard


def outline():
    """The invented release: an ellipse at the head of the channel."""
    from shapely import affinity, geometry

    circle = geometry.Point(WEST + COLUMNS * CELL / 2 - 20, SOUTH + 1920.0).buffer(1.0)
    return affinity.scale(circle, 90.0, 110.0)


def release_thickness(x, y):
    """15 m inside the outline."""
    return np.where(shapely.contains_xy(outline(), *np.meshgrid(x, y)), 15.0, 0.0)


@pytest.fixture(scope="session")
def site():
    """What the report needs of a site."""
    return SimpleNamespace(name="valley", resolved=lambda: SETTINGS, settings=SimpleNamespace(report=None))


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """The results folder."""
    import geopandas

    folder = tmp_path_factory.mktemp("study") / "results"
    x, y, _ = valley()
    maps = {m: flow(x, y, f) for m, f in enumerate(FRICTION) if m != FAILED}
    write_members(folder / "members", maps)
    write_members_file(folder / "members.nc", maps)
    hazard_dataset(maps).to_netcdf(folder / "hazard.nc")
    write_figures(folder / "members.nc")
    releases = geopandas.GeoDataFrame({"name": ["scar"]}, geometry=[outline()], crs="EPSG:32616")
    releases.to_file(folder / "outlines.gpkg", layer="release")
    dams = geopandas.GeoDataFrame({"height_m": [8.0]}, geometry=[DAM], crs="EPSG:32616")
    dams.to_file(folder / "outlines.gpkg", layer="obstacles")
    zones = {"factor": [1.5, None], "basal_friction_angle_deg": [None, 8.0]}
    geopandas.GeoDataFrame(zones, geometry=ZONES, crs="EPSG:32616").to_file(folder / "outlines.gpkg", layer="friction_zones")
    inputs = [{"name": "inputs/dem.tif", "size": 81234, "sha256": "ab" * 32}]
    ensemble = {"members_valid": 7, "failures": {"5": REASON}, "statement": "7 of 8 members are valid"}
    run = {"inputs": inputs, "ensemble": ensemble, "changes": CHANGES, "versions": {"runout": "0.1.0", "numpy": "2.4"}, "seed": 1}
    run |= {
        "created": "2026-05-04T10:20:30+00:00",
        "runout": "0.1.0",
        "metadata": METADATA,
        "resolution": RESOLUTION,
        "configuration": SETTINGS,
    }
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    return folder

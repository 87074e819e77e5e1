"""A small synthetic ensemble: members whose maps are known by formula, and a site that owns them."""

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pyproj
import shapely

from runout.config.site import Site
from runout.config.stated_at import Reading
from runout.io import netcdf
from runout.io.atomic import write_json
from runout.io.member_maps import RASTER, cut_to_reached
from runout.io.provenance import sha256
from runout.model.registered_law import for_arrays
from runout.model.release import Release
from runout.model.terrain import Terrain
from runout.quantities import QUANTITIES, peak_quantities

SHAPE = (37, 53)  # odd and unequal, so that a transposed or flipped map cannot pass
CELL = (10.0, 12.0)
WEST, SOUTH = 738_000.0, 4_020_000.0
THRESHOLDS = {
    "thickness": [0.1, 1.0, 2.0],
    "speed": [1.0, 5.0],
    "pressure": [3e3, 3e4],
    "momentum_flux": [10.0],
    "deposit": [0.5, 1.0],
}
MARKER = 9.5  # flow thickness of every member in the north-west corner [m]


def make_terrain(crs: str | None = "EPSG:32616") -> Terrain:
    """Plane that dips to the south-east, with one unknown cell in the south-east corner."""
    rows, columns = np.indices(SHAPE)
    elevation = 1000.0 - 3.0 * rows - 2.0 * columns
    elevation[-1, -1] = np.nan
    return Terrain(
        elevation, CELL, WEST, SOUTH, pyproj.CRS(crs).to_wkt() if crs else None, source="dem.tif", changes=("turned north up",)
    )


def peaks_of(thickness: np.ndarray, speed: np.ndarray) -> dict[str, np.ndarray]:
    """Maps of every quantity that has a formula, of a flow of 2000 kg/m3."""
    density = np.full(thickness.shape, 2000.0)
    return {q.member_map: for_arrays(q.formula)(thickness, speed, density) for q in peak_quantities()}


def member_maps(number: int) -> dict[str, np.ndarray]:
    """Maps of member ``number``: a tongue of 4 + 4 * number rows; thickness number + 1 [m]; the marker in the corner."""
    wet = np.zeros(SHAPE, bool)
    wet[2 : 6 + 4 * number, 5:20] = True
    thickness = np.where(wet, 1.0 + number, 0.0)
    thickness[0, 0] = MARKER
    wet[0, 0] = True
    speed = np.where(wet, 2.0 * (1 + number), 0.0)
    arrival = np.where(wet, np.indices(SHAPE)[0] * 2.0 + number, np.nan)
    return {
        **peaks_of(0.5 * thickness, speed),  # the maxima of thickness and speed are not at the same time
        "max_flow_thickness": thickness,
        "arrival_time": arrival,
        "deposit_thickness": thickness / 2,
    }


def write_member(folder: Path, number: int, terrain: Terrain) -> Path:
    """The member's file as a run of the ensemble leaves it."""
    maps = netcdf.map_dataset(terrain, member_maps(number), title=f"member {number}", attrs={"member_key": f"key {number}"})
    return netcdf.write(maps, folder / f"{number:04d}.nc")


def write_part(folder: Path, number: int, terrain: Terrain, maps: dict[str, np.ndarray]) -> Path:
    """The member's file with the part of the raster that its flow reached."""
    part, cut, attributes, raster = cut_to_reached(terrain, maps)
    known = {name: part.where_known(values) for name, values in cut.items()}
    dataset = netcdf.map_dataset(part, known, title=f"member {number}", attrs=attributes)
    return netcdf.write(dataset, folder / f"{number:04d}.nc", groups={RASTER: raster})


@dataclass(frozen=True)
class FakeSite:
    """The part of a site that the products use."""

    folder: Path
    crs: str | None = "EPSG:32616"
    name: str = "valley"
    changes: tuple[str, ...] = ()
    settings: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(
            title="A made-up valley",
            description="A hypothetical release.",
            metadata=None,
            structures=None,
            terrain=SimpleNamespace(dem="inputs/dem.tif"),
            hazard=SimpleNamespace(
                **{q.setting: [] for q in QUANTITIES.values() if q.name not in THRESHOLDS},
                **{QUANTITIES[name].setting: limits for name, limits in THRESHOLDS.items()},
                joint=[{"thickness": 2.0, "speed": 3.0}, {"pressure": 3e4, "deposit": 0.7, "momentum_flux": 1.0}],
                percentiles=[5, 50, 95],
                scheme=None,
            ),
            ensemble=SimpleNamespace(seed=7),
            simulation=SimpleNamespace(device="cpu"),
            inflow=None,
        )
    )

    def stated(self) -> dict[str, Any]:
        """What its site.yaml would say."""
        return {"name": self.name}

    def terrain(self) -> Terrain:
        """The terrain of the members."""
        return make_terrain(self.crs)

    def releases(self) -> list[Release]:
        """A block in the north-west."""
        thickness = np.zeros(SHAPE)
        thickness[2:5, 6:10] = 5.0
        return [Release(thickness, self.terrain(), name="scar")]

    @property
    def files(self) -> SimpleNamespace:
        """An elevation raster, and a dam of 4 m south of the release."""
        dam = SimpleNamespace(parts=[(shapely.box(WEST + 60.0, SOUTH + 200.0, WEST + 120.0, SOUTH + 240.0), 4.0)])
        return SimpleNamespace(
            zones=lambda: None,
            probes=lambda: None,
            obstacles=lambda: [dam],
            observations=lambda: Reading(None),
            inflows=lambda: Reading([]),
            paths=lambda *_: [self.folder / "inputs" / "dem.tif"],
            known=SimpleNamespace(sha256=sha256),
        )

    provenance = Site.provenance

    def resolved(self) -> dict:
        """A plain configuration."""
        return {"name": self.name, "simulation": {"cell_size": 20.0}}


MEMBERS = 5
FAILED, MISSING = 3, 4


def make_table(weights: list[float] | None = None) -> pd.DataFrame:
    """The table of five members."""
    return pd.DataFrame(
        {
            "basal_friction_angle_deg": np.linspace(12, 22, MEMBERS),
            "weight": weights or [1 / MEMBERS] * MEMBERS,
            "seed": np.arange(MEMBERS) + 100,
            "file": [f"{number:04d}.nc" for number in range(MEMBERS)],
        },
        index=pd.Index(range(MEMBERS), name="member"),
    )


def make_site(folder: Path, crs: str | None = "EPSG:32616") -> tuple[FakeSite, Path]:
    """A site and its results folder with members 0 to 2 valid, 3 failed, 4 not run."""
    site, results = FakeSite(folder / "site", crs), folder / "site" / "results"
    (site.folder / "inputs").mkdir(parents=True)
    (site.folder / "inputs" / "dem.tif").write_bytes(b"elevations")
    for number in range(3):
        write_member(results / "members", number, make_terrain(crs))
    write_json(
        {"reason": "the time step fell below 1e-6 s", "type": "StabilityError", "key": "k"},
        results / "members" / "0003.failed.json",
    )
    return site, results


@dataclass(frozen=True)
class Products:
    """A site whose products were written."""

    site: FakeSite
    results: Path
    paths: list[Path]


def write_all(folder: Path, crs: str | None) -> Products:
    """Products of a fresh site."""
    from runout.hazard.products import write_products

    site, results = make_site(folder, crs)
    return Products(site, results, write_products(site, results, make_table(), None))

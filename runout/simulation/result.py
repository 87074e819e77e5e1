"""The result of one run."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.model.depth_resolution import DepthResolution
from runout.model.facts import as_html, as_text, short
from runout.model.particles import Particles
from runout.model.probes import ProbeSeries
from runout.model.readers import reader
from runout.model.terrain import Terrain
from runout.quantities import CHANGE, ERODED
from runout.simulation.entering import never_started, sentences
from runout.simulation.structure_forces import StructureForces
from runout.terrain.relief import half_width

if TYPE_CHECKING:
    import xarray as xr


FIRST = ("first_row", "first_column")  # attributes of the file of a part of a raster


def _nothing() -> Particles:
    return Particles.zeros(0)


@dataclass
class Result:
    """Result of :func:`runout.simulate`.

    Attributes
    ----------
    bring : callable
        Brings the particles at the end from the backend, for :attr:`state`.
    steps, n_particles : int
        Time steps done; particles of all releases.
    timing : dict
        Seconds by stage: setup (with compilation), index, p2g, contact, g2p, sort, observers, total.
    stop_reason : str
        "at rest", "end time" or "all mass has left the domain".
    resolution : Resolution
        Cells through the depth of the flow and numerical viscosity.
    snapshots : list of tuple
        Time [s], thickness [m] and speed [m/s] (rows, columns) of each snapshot.
    particle_frames : list of ndarray (n, 4)
        Local position [m] and speed [m/s] of a sample of the particles at each snapshot; empty unless requested.
    structure_forces : StructureForces or None
        Impulses on structures over time, with force, moment and pressure of each facade; None without structures.
    start : mapping
        Initial stress, basal friction and stiffness, :meth:`runout.model.scene.Scene.start_attributes`; of releases that start
        later ``late_source``, ``late_source_start_time`` [s], NaN for never, and ``late_source_waiting_mass`` [kg]; with an
        erodible bed also ``bed_mass_at_end`` [kg], mass of the bed that has not left the domain.
    probes : ProbeSeries or None
        Time series at the points and cross-sections of ``simulate(probes=...)``.
    """

    terrain: Terrain
    fields: Mapping[str, np.ndarray]
    series: Mapping[str, np.ndarray]
    bring: Callable[[], Particles]
    spacing: tuple[float, float, float]
    steps: int
    n_particles: int
    timing: dict[str, float]
    stop_reason: str
    depth_resolution: DepthResolution
    snapshots: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    particle_frames: list[np.ndarray] = field(default_factory=list)
    start: Mapping[str, Any] = field(default_factory=dict)
    structure_forces: StructureForces | None = None
    probes: ProbeSeries | None = None

    @property
    def never_started(self) -> list[str]:
        """Names of the releases that waited until the end; their mass is ``waiting_mass`` of the ledger."""
        return never_started(self.start)

    @cached_property
    def state(self) -> Particles:
        """The particles at the end, in the order of their identity.

        The backend holds them until they are first asked for, or until there is no result any more.
        """
        particles, self.bring = self.bring(), _nothing
        return particles

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "state": self.state, "bring": _nothing}

    @cached_property
    def maps(self) -> "xr.Dataset":
        """Maps on the cells of the elevation raster, with its coordinate system.

        ``max_flow_thickness`` [m], ``max_speed`` [m s-1], ``max_pressure`` [Pa], ``max_momentum_flux`` [m3 s-2] (largest h v^2),
        ``arrival_time`` [s] (missing in cells that the flow does not reach) and ``deposit_thickness`` [m]. Thickness is vertical.
        With an erodible bed also ``eroded_depth`` and ``elevation_change`` [m] (deposit minus release and eroded depth), and
        ``bed_share`` [1], mass of the bed over mass of the deposit (missing without deposit). Cells without elevation are NaN.
        ``met_at_one_time`` exists with joint conditions only.
        """
        from runout.io.netcdf import map_dataset

        known = {name: self.terrain.where_known(values) for name, values in self.fields.items()}
        return map_dataset(self.terrain, known, title="Runout of one scenario", attrs=self._attributes())

    @cached_property
    def ledger(self) -> "xr.Dataset":
        """Sums over the whole mass against ``time`` [s]: mass, momentum, energies, dissipation, step and work.

        Its attributes state the resolution (:class:`runout.model.depth_resolution.Resolution`).
        """
        import xarray as xr

        from runout.variables import VARIABLES

        series = {k: ("time", v, VARIABLES[k].attributes()) for k, v in self.series.items() if k != "time"}
        time = ("time", self.series["time"], VARIABLES["time"].attributes())
        return xr.Dataset(series, coords={"time": time}, attrs=self.depth_resolution.attributes())

    @cached_property
    def particles(self) -> "xr.Dataset":
        """Positions in map coordinates [m], float64, velocities [m/s] and release of the particles at the end."""
        import xarray as xr

        position = self.terrain.frame.to_map(self.state.position(np.array(self.spacing)))
        columns = {
            "easting": position[:, 0],
            "northing": position[:, 1],
            "elevation": position[:, 2],
            "velocity_x": self.state.velocity[:, 0],
            "velocity_y": self.state.velocity[:, 1],
            "velocity_z": self.state.velocity[:, 2],
            "mass": self.state.mass,
            "release": self.state.release,
        }
        series = {name: ("particle", values) for name, values in columns.items()}
        return xr.Dataset(series, coords={"particle": self.state.identity})

    def plot(self, quantity: str = "thickness", *, title: str | None = None) -> Any:
        """Axes of matplotlib with a map over hillshade, on a new figure of pyplot.

        ``quantity`` is thickness, speed, pressure, momentum_flux, deposit or arrival; the first four are maxima over the run.
        """
        return reader("Result.plot")(self, quantity, title=title)

    def _facts(self) -> dict[str, str]:
        area, mass = self.terrain.cell_area, self.series["mass"]
        thickness, speed = (np.nan_to_num(self.fields[f"max_{name}"]) for name in ("flow_thickness", "speed"))
        deposit = np.nan_to_num(self.fields["deposit_thickness"])
        entrained = self.series["entrained_mass"][-1] if "entrained_mass" in self.series and mass[0] > 0 else None
        whole = mass[0] + sum(self.series[name][-1] for name in ("entered_mass", "entrained_mass") if name in self.series)
        bed = {} if entrained is None else self._facts_of_bed(entrained, area)
        return {
            "ended": f"{self.stop_reason} at {short(self.series['time'][-1], 's')}",
            "size": f"{self.n_particles} particles, {self.steps} steps, {short(self.timing.get('total', 0.0), 's')}",
            "largest thickness": short(thickness.max(), "m"),
            "largest speed": short(speed.max(), "m/s"),
            "area reached": short((thickness > 0).sum() * area, "m2"),
            "volume at the end": short(deposit.sum() * area, "m3"),
            "escaped": f"{100 * (1 - mass[-1] / whole):.3g} % of the mass" if whole > 0 else "no mass",
            **self._facts_of_sources(),
            **bed,
            "resolution": self.depth_resolution.statement(),
            "snapshots": str(len(self.snapshots)),
        }

    def _facts_of_sources(self) -> dict[str, str]:
        """When releases that waited started, and which never did."""
        said = "; ".join(sentences(self.start))
        return {"later": said} if said else {}

    def _facts_of_bed(self, entrained: float, area: float) -> dict[str, str]:
        """Volumes that the flow took up, and by which the ground is lower and higher, after taking up a mass ``entrained`` [kg]."""
        mass, share = self.series["mass"], entrained / self.series["mass"][0]
        of_bed = self.start["bed_mass_at_end"] / mass[-1] if mass[-1] > 0 else 0.0
        eroded, change = (np.nan_to_num(self.fields[name]) for name in (ERODED, CHANGE))
        lower, higher = (short(float(np.maximum(sign * change, 0.0).sum() * area), "m3") for sign in (-1.0, 1.0))
        return {
            "taken up": f"{short(float(eroded.sum() * area), 'm3')} of the bed, {100 * share:.3g} % of the released mass",
            "change of elevation": f"{lower} eroded, {higher} deposited",
            "deposit": f"{100 * of_bed:.3g} % of its mass are from the bed",
        }

    def __repr__(self) -> str:
        return as_text("Result", self._facts())

    def _repr_html_(self) -> str:
        return as_html("Result", self._facts())

    def snapshot_maps(self) -> "xr.Dataset":
        """Thickness [m] and speed [m/s] at the snapshot times, (time, y, x)."""
        from runout.io.netcdf import add_map, map_dataset

        dataset = map_dataset(self.terrain, {}, title="Snapshots of one scenario")
        dataset = dataset.assign_coords(time=("time", [t for t, _, _ in self.snapshots]))
        for name, frames in (("flow_thickness", [h for _, h, _ in self.snapshots]), ("speed", [v for _, _, v in self.snapshots])):
            add_map(dataset, name, self.terrain.where_known(np.array(frames)), ("time",))
        return dataset

    def snapshot_particles(self) -> "xr.Dataset":
        """Map coordinates [m] and speed [m/s] of a sample of the particles at the snapshot times, (time, particle).

        NaN for particles that have left the domain. Empty unless ``snapshot_particles`` was given to :func:`runout.simulate`.
        """
        import xarray as xr

        from runout.variables import VARIABLES

        frames = np.array(self.particle_frames, np.float64).reshape(len(self.particle_frames), -1, 4)
        columns = [*np.moveaxis(self.terrain.frame.to_map(frames[..., :3]), -1, 0), frames[..., 3]]
        names = ("particle_easting", "particle_northing", "particle_elevation", "particle_speed")
        series = {
            name: (("time", "particle"), values, VARIABLES[name].attributes()) for name, values in zip(names, columns, strict=True)
        }
        times = [t for t, _, _ in self.snapshots][: len(frames)]
        return xr.Dataset(series, coords={"time": ("time", times, VARIABLES["time"].attributes())})

    def to_netcdf(
        self, path: str | os.PathLike[str], attrs: Mapping[str, Any] | None = None, *, reached_only: bool = False
    ) -> None:
        """Write maps, ledger, snapshots and series at probes to one file, completely or not at all.

        With ``reached_only`` the maps hold the rows and columns that the flow reached; their place is in the attributes, that
        of the whole raster in the group ``raster``.
        """
        from runout.io.netcdf import write
        from runout.simulation.structure_forces import GROUP, facade_series

        shown, place, groups = self._reached() if reached_only else (self, {}, {})
        groups["ledger"] = self.ledger
        if self.structure_forces:
            groups[GROUP] = facade_series(self.structure_forces)
        if self.snapshots:
            groups["snapshots"] = shown.snapshot_maps()
        if self.particle_frames:
            groups["snapshot_particles"] = self.snapshot_particles()
        if self.probes:
            from runout.io.probe_files import series_datasets

            groups |= series_datasets(self.probes)
        write(shown.maps.assign_attrs(place | dict(attrs or {})), path, groups=groups)

    def _reached(self) -> "tuple[Result, dict[str, Any], dict[str, xr.Dataset]]":
        """Result on the part of the raster that the flow reached, attributes of its place, and the group of the whole raster."""
        from runout.io.member_maps import RASTER, cut_to_reached

        layers = {f"{k}": np.maximum(h, v) for k, (_, h, v) in enumerate(self.snapshots)}
        terrain, cut, attributes, raster = cut_to_reached(self.terrain, {**self.fields, **layers})
        rows, columns = (slice(attributes[name], attributes[name] + n) for name, n in zip(FIRST, terrain.shape, strict=True))
        part = replace(
            self,
            terrain=terrain,
            fields={name: cut[name] for name in self.fields},
            snapshots=[(t, h[rows, columns], v[rows, columns]) for t, h, v in self.snapshots],
        )
        return part, dict(attributes), {RASTER: raster}

    def _attributes(self) -> dict[str, Any]:
        run = {"steps": self.steps, "particles": self.n_particles, "stop_reason": self.stop_reason}
        run |= {"ground_filter_half_width": np.array(half_width(self.spacing))}
        return run | dict(self.start) | self.depth_resolution.attributes()

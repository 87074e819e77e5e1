"""Runout assessment of landslides, rock-ice avalanches and debris flows with a sparse material point method.

The public names are listed in ``__all__``; they are imported on first use, so that ``import runout`` stays quick. The classes
of the laws are among them: each file of :mod:`runout.materials`, :mod:`runout.friction` and :mod:`runout.erosion` brings its own.
"""

from runout.processes import ending

if ending.is_command():  # before slow imports, and before any from the working directory
    ending.end_at_once()
    from runout import safe_start

    safe_start.begin()

from importlib import import_module
from importlib.machinery import PathFinder
from typing import Any

from runout.model.readers import declare_readers

__version__ = "0.2.0"

_HOME = {
    "Terrain": "runout.model.terrain",
    "Release": "runout.model.release",
    "Placement": "runout.model.release",
    "StartVelocity": "runout.model.release_start",
    "Arrival": "runout.model.release_start",
    "Material": "runout.model.materials",
    "parameter": "runout.model.parameters",
    "register_law": "runout.model.laws",
    "BasalFriction": "runout.model.basal_friction",
    "register_friction": "runout.model.friction_laws",
    "FrictionZones": "runout.model.friction",
    "PorePressure": "runout.model.pore_pressure",
    "RatioZones": "runout.model.pore_pressure",
    "Bed": "runout.model.bed",
    "Inflow": "runout.model.inflow",
    "Hydrograph": "runout.model.inflow",
    "Erosion": "runout.model.erosion_laws",
    "register_erosion": "runout.model.erosion_laws",
    "Structures": "runout.model.structures",
    "StructureSource": "runout.structures.source",
    "Particles": "runout.model.particles",
    "Probes": "runout.model.probes",
    "ProbeSeries": "runout.model.probes",
    "Scene": "runout.model.scene",
    "simulate": "runout.simulation.single",
    "Result": "runout.simulation.result",
    "Site": "runout.config.site",
    "read_site": "runout.config.site",
    "ScarpPlane": "runout.slopes.scarp",
    "scarp_ellipsoid": "runout.slopes.scarp",
    "scarp_planes": "runout.slopes.scarp",
    "RunoutError": "runout.errors",
    "DemError": "runout.errors",
    "ReleaseError": "runout.errors",
    "ZoneError": "runout.errors",
    "ObservationError": "runout.errors",
    "StructureError": "runout.errors",
    "ConfigError": "runout.errors",
    "MaterialError": "runout.errors",
    "CapacityError": "runout.errors",
    "StabilityError": "runout.errors",
    "DeviceError": "runout.errors",
    "RenderError": "runout.errors",
}

_PACKAGES = ("scores",)  # public as a whole

declare_readers(
    {
        "Terrain.from_array": "runout.terrain.read:terrain_from_array",
        "Terrain.from_raster": "runout.terrain.read:read_terrain",
        "Terrain.from_mesh": "runout.terrain.mesh:terrain_from_mesh",
        "Terrain.averaged": "runout.terrain.averaging:averaged",
        "Terrain.smoothed": "runout.terrain.averaging:smoothed",
        "Terrain.with_obstacles": "runout.terrain.obstacles:with_obstacles",
        "Terrain.plot": "runout.report.plots:plot_terrain",
        "Release.plot": "runout.report.plots:plot_release",
        "Result.plot": "runout.report.plots:plot_result",
        "Release.from_array": "runout.release.read:release_from_array",
        "Release.from_raster": "runout.release.read:read_raster",
        "Release.from_vector": "runout.release.read:read_vector",
        "Probes.from_vector": "runout.io.probe_layers:read_probes",
        "Structures.from_file": "runout.structures.read:structures_from_file",
        "Structures.from_sources": "runout.structures.read:structures_from_sources",
        "Bed.from_vector": "runout.terrain.beds:read_bed_polygons",
        "Inflow.from_vector": "runout.release.inlet:read_inflow",
        "RatioZones.from_vector": "runout.terrain.zones:read_ratio_zones",
        "Bed.from_raster": "runout.terrain.beds:read_bed_raster",
        "FrictionZones.from_vector": "runout.terrain.zones:read_zones",
        "FrictionZones.from_rasters": "runout.terrain.friction_rasters:read_friction_rasters",
    }
)


def _homes() -> dict[str, str]:
    """Module of every public name, those of the laws included."""
    from runout.model.erosion_laws import EROSIONS
    from runout.model.friction_laws import FRICTIONS
    from runout.model.laws import LAWS
    from runout.model.registered_law import public_names

    return _HOME | public_names(LAWS) | public_names(FRICTIONS) | public_names(EROSIONS)


def __getattr__(name: str) -> Any:
    if name.startswith("_") and name != "__all__":
        raise AttributeError(f"module 'runout' has no attribute {name!r}")
    if name in _PACKAGES:
        return import_module(f"runout.{name}")
    if name not in _HOME and name.islower() and PathFinder.find_spec(f"runout.{name}", __path__):
        raise AttributeError(f"module 'runout' has no attribute {name!r} before it is imported")
    homes = _HOME if name in _HOME else _homes()
    if name == "__all__":
        return sorted([*homes, *_PACKAGES])
    if name not in homes:
        raise AttributeError(f"module 'runout' has no attribute {name!r}")
    value = getattr(import_module(homes[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_homes(), *_PACKAGES})

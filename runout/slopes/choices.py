"""Choices of the commands on slopes. Those that site.yaml may state are checked as the block ``stability`` is."""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from runout.errors import ConfigError
from runout.model.limits import Range, checked_within

_IN_DEGREES = ("azimuth", "tilt")
_PARTS = {
    "ellipsoid": ("easting", "northing", "along_azimuth", "across_azimuth", "depth"),
    "plane": ("easting", "northing", "depth", "dip_deg", "azimuth_deg"),
}

SAMPLED = ("cohesion", "friction_angle", "soil_thickness", "transmissivity_recharge", "saturation")
_WASTING = {
    "critical_slope": Range(0.001, 2),
    "threshold_flux": Range(1e-3, 100, "m"),
    "erosion_coefficient": Range(0, 10),
    "erodible_thickness": Range(0, 100, "m"),
    "grain_diameter": Range(1e-4, 10, "m"),
}


def record(choices: Any) -> dict[str, Any]:
    """Choices by name for a JSON record: angles in degrees say so, and numbers of an ellipsoid or a plane have names."""
    content: dict[str, Any] = {}
    for name, value in asdict(choices).items():
        if name == "ellipsoid" and value is not None:
            value = dict(zip(_PARTS[name], value, strict=True))
        elif name == "plane":
            value = [dict(zip(_PARTS[name], one, strict=True)) for one in value]
        content[f"{name}_deg" if name in _IN_DEGREES else name] = value
    return content


@dataclass(frozen=True)
class Strength:
    """Options on the soil, each range sampled uniformly and independently; None: as site.yaml states, or the default.

    Uniform ranges are the approach of SINMAP (Pack, Tarboton and Goodwin 1998, Terrain Stability Mapping with SINMAP). The default
    ranges are assumptions for shallow soil in mountains, not values of a site.
    """

    cohesion: tuple[float, float] | None = None
    """Of soil and roots [Pa] [default: 0 4900]."""
    friction_angle: tuple[float, float] | None = None
    """Internal friction angle [deg] [default: 30 45]."""
    soil_thickness: tuple[float, float] | None = None
    """Vertical thickness above the failure surface [m] [default: 0.5 1.5]."""
    soil_density: float | None = None
    """Wet bulk density [kg m-3] [default: 2000]."""
    transmissivity_recharge: tuple[float, float] | None = None
    """Transmissivity over recharge [m]: small in wet weather [default: 2000 3000]."""
    saturation: tuple[float, float] | None = None
    """Share of the soil thickness below water [1], in place of the wetness from drainage area and recharge."""
    samples: int | None = None
    """Number of samples, a power of two [default: 256]."""
    sample_seed: int | None = None
    """Seed of the samples [default: 0]."""


@dataclass(frozen=True)
class PatchChoices:
    """Options on which cells make a release, and how many are proposed; None: as site.yaml states, or the default."""

    probability: float | None = None
    """Least probability of failure of its cells [default: 0.5]."""
    largest_drainage: float | None = None
    """Largest drainage area of its cells [m2]: larger ones are channels [default: 1e5]."""
    least_area: float | None = None
    """Least area of a release [m2] [default: 500]."""
    most: int | None = None
    """Largest number of releases, the first in rank [default: 20]."""


Five = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class ScarpChoices:
    """Shape of a scarp: an ellipsoid, or planes."""

    ellipsoid: Five | None = None
    """Easting and northing of the middle, semi-axes along and across the azimuth, vertical depth, all in m."""
    azimuth: float | None = None
    """Direction of the first axis, clockwise from north [deg] [default: downslope]."""
    tilt: float | None = None
    """Inclination of the plane through the rim, down along the azimuth [deg] [default: that of the ground]."""
    plane: tuple[Five, ...] = ()
    """Easting, northing, depth below the ground there [m], dip and direction of the dip [deg]; repeat it for every plane."""
    outline: Path | None = None
    """Polygons that limit the mass above planes."""
    volume: float | None = None
    """Volume to which the thickness is scaled [m3]."""
    name: str = "thickness"
    """Name of the raster."""

    def __post_init__(self) -> None:
        if (self.ellipsoid is None) == (not self.plane):
            fault = "both are given" if self.plane else "neither is given"
            raise ConfigError(f"a scarp is --ellipsoid or --plane; {fault}; state one kind")
        others = {"--azimuth": self.azimuth, "--tilt": self.tilt} if self.plane else {"--outline": self.outline}
        for option, value in others.items():
            if value is not None:
                raise ConfigError(f"{option} has no meaning with {'--plane' if self.plane else '--ellipsoid'}; leave it out")


@dataclass(frozen=True)
class MassWasting:
    """Parameters of MassWastingRunout (Keck et al. 2024, Earth Surf. Dynam. 12:1165).

    Defaults are those of landlab's tutorial, calibrated there to a landslide of 22 000 m3 in the Cascade Mountains.
    """

    critical_slope: float = 0.156
    """Slope [1] below which the flow deposits."""
    threshold_flux: float = 0.766
    """Flow depth [m] below which the flow stops."""
    erosion_coefficient: float = 0.0337443
    """Scour [m] by shear stress; 0 for none."""
    erodible_thickness: float = 1.2
    """Soil that the flow can entrain [m]."""
    grain_diameter: float = 0.316
    """Representative grain diameter [m]."""
    resolution: float | None = None
    """Cell size [m] [default: the terrain's, or coarser to take about a minute at most]."""

    def __post_init__(self) -> None:
        for name, valid in _WASTING.items():
            checked_within(valid, "--" + name.replace("_", "-"), getattr(self, name), error=ConfigError)
        if self.resolution is not None and not 0.0 < self.resolution < math.inf:
            raise ConfigError(f"--resolution is {self.resolution:g} m; it must be above 0")

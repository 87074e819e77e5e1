"""Valid ranges of inputs in site.yaml, attributes, rasters and Python. Laws declare the ranges of their own parameters."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Any

from runout.errors import ConfigError, InputError
from runout.physics.pore_pressure import LARGEST_RATIO
from runout.physics.substeps import MOST_SUBSTEPS

LARGEST_CFL = 0.6  # largest Courant number of any material
CFL = 0.6  # default
PARTICLES_PER_CELL = (2, 2, 4)  # default; release/arrangement.py has another one for masses that stay thick
LARGEST_RADIANS = 1.5708  # angles up to a quarter turn in radians are taken for radians, not degrees
SMALLEST_RADIANS = 0.02  # smaller angles are valid degrees (fluids) and implausible radians

SMALLEST_NET = 16  # members of a Sobol net whose sampling error can be found


@dataclass(frozen=True)
class Range:
    """Valid range of a quantity."""

    # low, high: smallest and largest value, both valid unless `open_low`
    low: float
    high: float
    unit: str = ""  # of both
    hint: str = ""  # remedy for a value outside the range
    open_low: bool = False  # `low` itself is not valid
    degrees: bool = False  # an angle in degrees, of which values that look like radians are refused

    def holds(self, value: float) -> bool:
        """Whether a value lies in the range."""
        return self.low <= value <= self.high and not (self.open_low and value == self.low)

    def bounds(self) -> dict[str, float]:
        """The range as keyword arguments of pydantic."""
        return {"gt" if self.open_low else "ge": self.low, "le": self.high}

    def words(self) -> str:
        """The range as text for a table."""
        return f"{'above ' if self.open_low else ''}{self.low:g} to {self.high:g}"

    def allowed(self) -> str:
        """The range as text for a message."""
        bound = "above" if self.open_low else "at least"
        return f"it must be {bound} {self.low:g} and at most {self.high:g}" + (f" {self.unit}" if self.unit else "")


LIMITS = {
    "thickness": Range(1e-5, 1000, "m", "thickness is vertical, in metres"),
    "volume": Range(1e-9, 1e12, "m3", "1 million m3 is 1.0e6"),
    "basal_friction_angle": Range(0, 60, "deg", degrees=True),
    "release_volume_factor": Range(0, 100, hint="1 is the volume as stated", open_low=True),
    "friction_factor": Range(0, 10),
    "bed_depth": Range(0, 1000, "m", "depth is vertical, in metres", open_low=True),
    "bed_density": Range(1, 20000, "kg/m3"),
    "bed_depth_factor": Range(0, 100, hint="1 is the depth as stated", open_low=True),
    "discharge_factor": Range(0, 100, hint="1 is the discharge as stated", open_low=True),
    "inflow_delay": Range(0, 86400, "s", "it is added to the times of the hydrograph"),
    "bulking": Range(0.1, 10, hint="1 is a deposit as dense as the mass"),
    "obstacle_height": Range(-300, 300, "m"),
    "structure_height": Range(0, 1000, "m", "it is measured from the ground upwards", open_low=True),
    "structure_clearance": Range(0, 1000, "m"),
    "elevation": Range(-12000, 9000, "m"),
    "cell_size": Range(1e-5, 1000, "m"),
    "resolution": Range(1e-5, 1e5, "m"),
    "smoothing": Range(0, 1e5, "m", "it is the half-width of a mean over elevations", open_low=True),
    "end_time": Range(1e-6, 86400, "s"),
    "start_time": Range(0.0, 86400, "s"),
    "release_speed": Range(0.0, 200.0, "m/s"),
    "azimuth": Range(0.0, 360.0, "deg", "clockwise from north"),
    "arrival_threshold": Range(1e-6, 1000, "m"),
    "substeps": Range(1, MOST_SUBSTEPS),
    "pore_pressure_ratio": Range(0, LARGEST_RATIO, hint="it is pore pressure over total normal stress"),
    "pore_pressure_block": Range(0.01, 1e5, "m", "it is the size of the blocks that get a ratio of their own"),
    "saturation": Range(0, 1, hint="1 is a mass whose voids are full of water up to its surface"),
    "diffusivity": Range(0, 100, "m2/s", "0.001 is usual for debris flows", open_low=True),
    "decay_time": Range(0, 1e6, "s", "it is the time in which the excess falls to 1/e", open_low=True),
    "cfl": Range(0, LARGEST_CFL, hint=f"{LARGEST_CFL:g} is usual", open_low=True),
}


def looks_like_radians(angle: float) -> bool:
    """Whether an angle [deg] was probably given in radians; 0 and very small angles are not."""
    return SMALLEST_RADIANS <= angle <= LARGEST_RADIANS


def radians_remedy(angle: float) -> str:
    """Remedy for an angle that was given in radians."""
    return f"write {math.degrees(angle):.3g} if it is {angle:g} radians"


def is_number(value: Any) -> bool:
    """Whether a value is a real number; truth values, text and dates are not."""
    return isinstance(value, Real) and not isinstance(value, bool)


def checked(name: str, value: Any, *, place: str = "", key: str = "", error: Callable[[str], Exception] = InputError) -> float:
    """The value of a quantity of :data:`LIMITS`, by its name, as a number.

    Raises ``error`` if the value is not a finite number or outside the range. The message states place, key (by default the name),
    value, range and remedy.
    """
    return checked_within(LIMITS[name], f"{place}: {key or name}" if place else key or name, value, error=error)


def checked_within(valid: Range, what: str, value: Any, *, error: Callable[[str], Exception] = InputError) -> float:
    """The value of ``what`` as a number in a range; errors as for :func:`checked`."""
    unit = f" in {valid.unit}" if valid.unit else ""
    if not is_number(value):
        raise error(f"{what} is {value!r}; it must be a number{unit}")
    number = float(value)
    if not math.isfinite(number):
        raise error(f"{what} is {number:g}; it must be a finite number{unit}")
    value_text = f"{what} is {number:g}" + (f" {valid.unit}" if valid.unit else "")
    if not valid.holds(number):
        raise error(f"{value_text}; {valid.allowed()}" + (f"; {valid.hint}" if valid.hint else ""))
    if valid.degrees and looks_like_radians(number):
        raise error(f"{value_text}, which is suspiciously small; angles are in degrees here; {radians_remedy(number)}")
    return number


def checked_radians(name: str, value: Any, what: str, *, error: Callable[[str], Exception] = InputError) -> float:
    """An angle [rad] as a number, within the limits of a quantity of :data:`LIMITS` in degrees; ``what`` names it in messages.

    Raises the given error if it is not a finite number or outside the limits; for a number of degrees the remedy converts it.
    """
    valid = LIMITS[name]
    if not is_number(value) or not math.isfinite(value):
        raise error(f"{what} is {value!r}; it must be a finite number in radians, for example math.radians(20)")
    number, turned = float(value), math.degrees(value)
    if valid.holds(round(turned, 9)):
        return number
    meant = f"; write math.radians({number:g}) if it is in degrees" if valid.holds(number) else ""
    most = f"{math.radians(valid.high):.4g} rad ({valid.high:g} deg)"
    raise error(f"{what} is {number:g} rad ({turned:.4g} deg); it must be at least {valid.low:g} and at most {most}{meant}")


def checked_coefficient(value: float, what: str, *, error: Callable[[str], Exception] = InputError) -> float:
    """A Coulomb coefficient [1], the tangent of a friction angle; ``what`` names it in messages.

    Raises the given error if it is not a finite number, or that of no friction angle; for a number of degrees the remedy converts
    it.
    """
    valid = LIMITS["basal_friction_angle"]
    if not is_number(value) or not math.isfinite(value) or value < 0:
        raise error(f"{what} is {value!r}; it must be a number of 0 or more, the tangent of the friction angle")
    turned = math.degrees(math.atan(value))
    if round(turned, 9) <= valid.high:
        return float(value)
    meant = f"; write math.tan(math.radians({value:g})) if it is an angle in degrees" if valid.holds(float(value)) else ""
    most = f"{math.tan(math.radians(valid.high)):.3g} ({valid.high:g} deg)"
    raise error(f"{what} is {value:g}, the tangent of {turned:.3g} deg; it must be at most {most}{meant}")


def spacing_of(cell_size: float | tuple[float, float, float]) -> tuple[float, float, float]:
    """Spacing of the grid [m] along x, y and z from one number or three; ConfigError outside the limits."""
    import numpy as np

    try:
        sizes = np.broadcast_to(np.asarray(cell_size, float), 3)
    except (TypeError, ValueError):
        raise ConfigError(f"cell_size is {cell_size!r}; give one number in m or (dx, dy, dz)") from None
    x, y, z = (checked("cell_size", float(size), error=ConfigError) for size in sizes)
    return x, y, z


MOST_SAMPLES = 4096  # of the soil of slopes that may fail
SOIL_RANGES = {
    "cohesion": Range(0, 1e6, "Pa"),
    "friction_angle": Range(1, 60, "deg", degrees=True),
    "soil_thickness": Range(0.01, 100, "m", "thickness is vertical, in metres"),
    "saturation": Range(0, 1, "", "1 is water up to the surface"),
    "transmissivity_recharge": Range(1, 1e6, "m", "transmissivity over recharge"),
    "soil_density": Range(1000, 4000, "kg m-3"),
}

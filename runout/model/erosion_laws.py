"""Registry of laws of erosion: each file of :mod:`runout.erosion` registers one, which is found by name."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from types import FunctionType
from typing import Any, ClassVar

from runout.errors import ConfigError
from runout.model.parameters import parameters_of
from runout.model.registered_law import RegisteredLaw, law_followed, register
from runout.model.registry import Registry

PACKAGE = "runout.erosion"
DEFAULT_EROSION = "ramms"
ARGUMENTS = 7  # of ``rate``
DENSITY, PORE_RATIO = "density", "pore_ratio"  # of the bed [kg/m3], [1], beside the parameters in the record that ``rate`` reads


@dataclass(frozen=True, kw_only=True)
class Erosion:
    """Base of every law of the rate at which a flow erodes its bed.

    A law adds its parameters as fields (:mod:`runout.model.parameters`) and is registered with its rate by
    :func:`runout.register_erosion`. A value out of its range is a ConfigError.
    """

    law: ClassVar[str] = ""  # name in site.yaml
    of_friction: ClassVar[bool] = False  # whether tau is the friction of the flow on the ground, not the driving stress

    def __post_init__(self) -> None:
        for p in parameters_of(type(self)):
            object.__setattr__(self, p.name, p.checked(getattr(self, p.name), ConfigError))

    def numbers(self) -> dict[str, float]:
        """The parameters by name, in SI units and radians."""
        return {p.name: p.si(getattr(self, p.name)) for p in parameters_of(type(self))}


@dataclass(frozen=True)
class ErosionLaw(RegisteredLaw[Erosion]):
    """A registered law of erosion."""

    rate: FunctionType  # erosion rate of a column, see :func:`register_erosion`
    package = PACKAGE

    @property
    def function(self) -> FunctionType:
        """Its rate."""
        return self.rate

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """Names of the numbers of a record, which ``rate`` reads."""
        return (*(p.name for p in self.parameters), DENSITY, PORE_RATIO)


EROSIONS: Registry[ErosionLaw] = Registry("erosion law", PACKAGE, "runout.erosion", ConfigError)


def register_erosion(erosion: type[Erosion], rate: Callable[..., Any]) -> None:
    """Register a law of erosion under the name ``erosion.law``.

    Parameters
    ----------
    erosion : type of Erosion
        Frozen dataclass of keyword-only parameters, each made by :func:`runout.model.parameters.parameter`.
    rate : function
        ``rate(H, u, sigma, tau, pore_ratio, eroded, bed) -> E``: rate [m/s] normal to the ground under a column of the flow.
        ``H`` is its thickness normal to the ground [m], ``u`` its mean speed [m/s], ``sigma`` the total normal stress and ``tau``
        the shear stress at its base [Pa] (the driving stress, or with ``erosion.of_friction`` that of the law of friction),
        ``pore_ratio`` its pore pressure over sigma [1], ``eroded`` the depth eroded so far, normal to the ground [m], ``bed`` the
        record of the parameters in SI units and radians, and of ``density`` [kg/m3] and ``pore_ratio`` [1] of the bed. Plain scalar
        Python of the shared subset (:mod:`runout.model.registered_law`).

    Raises
    ------
    ConfigError
        If the declaration is incomplete or inconsistent, or another law has the name.
    """
    if not isinstance(rate, FunctionType) or len(inspect.signature(rate).parameters) != ARGUMENTS:
        wanted = "a plain function of (H, u, sigma, tau, pore_ratio, eroded, bed)"
        raise ConfigError(f"erosion law {erosion.law}: rate must be {wanted}, not {rate!r}")
    law = ErosionLaw(erosion.law, erosion, rate)
    register(EROSIONS, law, Erosion, ConfigError, ranges=True)


def erosion_law_of(erosion: Erosion) -> ErosionLaw:
    """The law that an erosion follows; ConfigError if its class is not registered."""
    return law_followed(EROSIONS, erosion, "register_erosion")

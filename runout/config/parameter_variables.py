"""Variables of the sampled parameters in tables of members, from the declarations of the laws."""

import re
from dataclasses import replace

from runout.config import release_start
from runout.config.bed import PREFIX as ERODES
from runout.config.friction import OF_RELEASE, PREFIX
from runout.errors import ConfigError
from runout.model.erosion_laws import EROSIONS
from runout.model.friction_laws import FRICTIONS
from runout.model.laws import LAWS
from runout.model.parameters import Parameter
from runout.variables import VARIABLES, Variable


def parameter_variable(name: str) -> Variable:
    """Unit and name of a column of the table of members: of :data:`VARIABLES`, or of the parameter of a law with that key.

    A parameter of one release (:mod:`runout.config.release_laws`) has the unit of that parameter.

    Raises ConfigError if there is none.
    """
    if valid := release_start.own_range(name):
        return Variable(udunits(valid.unit), release_start.words_of(name), dtype="float64")
    release, dot, parameter = name.partition(OF_RELEASE)
    if dot:  # of one release
        variable = parameter_variable(parameter)
        return replace(variable, long_name=f"release {release}, {variable.long_name}", standard_name=None)
    if name in VARIABLES:
        return VARIABLES[name]
    declared = {p.key: _variable(p) for law in LAWS.known() for p in law.parameters if p.sampled}
    frictions = (p for law in FRICTIONS.known() for p in law.parameters if p.sampled)
    declared |= {PREFIX + p.key: _variable(p, " (basal friction)") for p in frictions}
    declared |= {ERODES + p.key: _variable(p, " (erosion)") for law in EROSIONS.known() for p in law.parameters if p.sampled}
    if name not in declared:
        raise ConfigError(f"{name}: no known law has this parameter; install the package of the law that the members follow")
    return declared[name]


def _variable(p: Parameter, of: str = "") -> Variable:
    return Variable(udunits(p.valid.unit if p.valid else ""), p.description + of, dtype="float64")


def udunits(unit: str) -> str:
    """A declared unit (``m/s2``) as UDUNITS write it in files (``m s-2``)."""
    if unit in ("", "deg"):
        return "degree" if unit else "1"
    above, _, below = unit.partition("/")
    lower = [f"{base}-{power or 1}" for base, power in re.findall(r"([A-Za-z]+)(\d*)", below)]
    return " ".join(([] if above == "1" else [above]) + lower)

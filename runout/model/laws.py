"""Material laws: registered by the file that each stands in, found by name."""

import inspect
import math
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields
from functools import cached_property
from types import FunctionType
from typing import TYPE_CHECKING, Any

from runout.errors import MaterialError
from runout.model.law_source import fingerprint, functions_of_law, require_shared_subset
from runout.model.materials import Material
from runout.model.parameters import Parameter, numpydoc, parameters_of
from runout.model.registry import Registry, classes_in
from runout.physics import elastic, plastic

if TYPE_CHECKING:
    import numpy as np

PACKAGE = "runout.materials"
ARGUMENTS = 3  # of ``update``: Hencky strain, history variable, record of parameters


@dataclass(frozen=True)
class Law:
    """A registered law.

    Attributes
    ----------
    name : str
        In site.yaml.
    material : type of Material
        Its parameters and what derives from them.
    update : function or None
        Return mapping, see :func:`register_law`; None for a material that never yields.
    """

    name: str
    material: type[Material]
    update: FunctionType | None

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters."""
        return parameters_of(self.material)

    @property
    def declaration(self) -> type[Material]:
        """The class that declares its parameters."""
        return self.material

    @property
    def is_of_runout(self) -> bool:
        """Whether it belongs to runout, not to another package."""
        return self.material.__module__.startswith(f"{PACKAGE}.")

    @cached_property
    def example(self) -> Material:
        """A material with default and typical parameters."""
        return self.material(**{p.name: p.typical for p in self.parameters})

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """Names of the numbers of a parameter record."""
        return tuple(self.example.record())

    @cached_property
    def fingerprint(self) -> str:
        """Checksum of the sources: compiled code and results of a law of another package depend on it."""
        return fingerprint(self.material, self.update)

    @property
    def source(self) -> str:
        """What results depend on beside the version of runout: :attr:`fingerprint` of a law of another package, else nothing."""
        return "" if self.is_of_runout else self.fingerprint

    def table(self, materials: tuple[Material, ...], dtype: Any = float) -> "np.ndarray":
        """Structured array (materials,) of the records."""
        import numpy as np

        records = [m.record() for m in materials]
        return np.array([tuple(r[f] for f in self.fields) for r in records], dtype=[(f, dtype) for f in self.fields])

    @cached_property
    def step(self) -> FunctionType:
        """``step(B, L, history, mat)`` in plain Python: :func:`runout.physics.plastic.step` with the return of this law."""
        return self._with_return(plastic.step) if self.update else elastic.step  # type: ignore[return-value]

    @cached_property
    def step_small(self) -> FunctionType:
        """:attr:`step` for small strain: :func:`runout.physics.plastic.step_small` with the return of this law."""
        return self._with_return(plastic.step_small) if self.update else elastic.step_small  # type: ignore[return-value]

    def _with_return(self, step: Any) -> FunctionType:
        own = FunctionType(step.__code__, {**step.__globals__, "law_return": self.update}, step.__name__)
        own.__annotations__, own.__module__, own.__doc__ = dict(step.__annotations__), step.__module__, step.__doc__
        return own

    @property
    def depends_on_rate(self) -> bool:
        """Whether the records hold the length of the step [s], ``time_step``, which the backend keeps up to date."""
        return self.material.depends_on_rate

    def set_step(self, table: "np.ndarray", dt: float) -> None:
        """Put the length of the coming steps [s] into the records of a law that depends on the rate."""
        if self.depends_on_rate:
            table["time_step"] = dt


LAWS: Registry[Law] = Registry("material law", PACKAGE, "runout.laws", MaterialError)


def register_law(material: type[Material], update: Callable[..., Any] | None = None) -> None:
    """Make a law known to all parts of runout, by the name ``material.law``.

    Parameters
    ----------
    material : type of Material
        Frozen dataclass of keyword-only parameters, each made by :func:`runout.model.parameters.parameter` or its kin.
    update : function, optional
        ``update(h, history, mat) -> (h, history, lost)``: Hencky strain [1] of the stress that is left of a trial strain ``h``, the
        history variable, and the energy [J/m3] dissipated per stress-free volume. ``mat`` holds the numbers of
        ``material.record()``. Plain scalar Python of the shared subset (:mod:`runout.model.law_source`), compiled for every
        backend. None for a material that never yields.

    Raises
    ------
    MaterialError
        If the declaration does not hold together, or another law has the name.
    """
    law = Law(material.law, material, _function(material, update))
    _require_declared(law)
    if law.update and not law.is_of_runout:  # the tests of runout check its own
        for function in functions_of_law(law.update):
            require_shared_subset(function)
    material.__doc__ = numpydoc(material)
    LAWS.add(law.name, f"{material.__module__}.{material.__qualname__}", law)


def _function(material: type[Material], update: Any) -> FunctionType | None:
    if update is None:
        return None
    if not isinstance(update, FunctionType) or len(inspect.signature(update).parameters) != ARGUMENTS:
        raise MaterialError(f"law {material.law}: update must be a plain function of (h, history, mat), not {update!r}")
    return update


def _require_declared(law: Law) -> None:
    """Nothing, if the class of a law says all that is derived from it."""
    said = f"law {law.name or law.material.__qualname__}"
    undecorated = any(isinstance(value, Field) for value in vars(law.material).values())
    if undecorated or not (issubclass(law.material, Material) and law.name.isidentifier()):
        raise MaterialError(f"{said}: write a frozen dataclass that derives from runout.Material, with `law` as its name")
    declared = {p.name for p in law.parameters}
    for field in fields(law.material):
        if field.name not in declared:
            raise MaterialError(f"{said}: {field.name} is not declared; write {field.name}: float = parameter(...)")
    for p in law.parameters:
        if p.typical is MISSING:
            raise MaterialError(f"{said}: {p.name} has neither default= nor typical=; tests and tables need one")
    for name, value in law.example.record().items():
        if not (name.isidentifier() and math.isfinite(value)):
            raise MaterialError(f"{said}: record() has {name} = {value!r}; finite numbers by name are needed")


def public_names() -> dict[str, str]:
    """Module of each class that the files of runout's laws define, by its name."""
    return classes_in(law.material.__module__ for law in LAWS.of_runout())


def law_of(material: Material) -> Law:
    """The law that a material follows.

    Raises
    ------
    MaterialError
        If its class is not registered.
    """
    law = LAWS.find(material.law)
    if not isinstance(material, law.material):
        raise MaterialError(f"{type(material).__name__} is not the registered law {material.law}; register it with register_law")
    return law

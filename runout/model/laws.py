"""Registry of material laws: each file of :mod:`runout.materials` registers one, which is found by name."""

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from types import FunctionType
from typing import TYPE_CHECKING, Any

from runout.errors import MaterialError
from runout.model.materials import Material
from runout.model.registered_law import RegisteredLaw, calling, functions_of_law, law_followed, register
from runout.model.registry import Registry
from runout.physics import elastic, plastic

if TYPE_CHECKING:
    import numpy as np

PACKAGE = "runout.materials"
ARGUMENTS = "h", "history", "mat"  # of a return mapping: Hencky strain, history variable, record of parameters
EFFECTIVE_ARGUMENTS = *ARGUMENTS, "effective"  # share of the mean stress that grains carry


@dataclass(frozen=True)
class Law(RegisteredLaw[Material]):
    """A registered law of the material."""

    update: FunctionType | None  # return mapping (h, history, mat); None for a material that never yields
    effective_update: FunctionType | None = None  # (h, history, mat, effective): the function of a law that states this one
    package = PACKAGE

    @property
    def material(self) -> type[Material]:
        """The class that declares its parameters, and what derives from them."""
        return self.declaration

    @property
    def function(self) -> FunctionType | None:
        """Its return mapping."""
        return self.update

    @property
    def functions(self) -> tuple[FunctionType, ...]:
        """Its return mapping, and that by effective stress if it states that one."""
        own: list[Any] = [self.update, self.effective_update]
        return tuple(f for f in own if f)

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """Names of the numbers of a parameter record."""
        return tuple(self.example.record())

    def table(self, materials: tuple[Material, ...], dtype: Any = float, cell_size: float = 1.0) -> "np.ndarray":
        """Structured array (materials,) of the records, for cells of ``cell_size`` [m]."""
        import numpy as np

        cell = {"cell_size": cell_size} if "cell_size" in self.fields else {}
        records = [m.record() | cell for m in materials]
        return np.array([tuple(r[f] for f in self.fields) for r in records], dtype=[(f, dtype) for f in self.fields])

    @cached_property
    def step(self) -> FunctionType:
        """``step(B, L, history, mat)`` in plain Python: :func:`runout.physics.plastic.step` with the return of this law."""
        return calling(plastic.step, law_return=self.update) if self.update else elastic.step  # type: ignore[return-value]

    @cached_property
    def step_small(self) -> FunctionType:
        """:attr:`step` for small strain: :func:`runout.physics.plastic.step_small` with the return of this law."""
        return calling(plastic.step_small, law_return=self.update) if self.update else elastic.step_small  # type: ignore[return-value]

    @cached_property
    def effective_step(self) -> FunctionType:
        """:attr:`step` by effective stress, :func:`runout.physics.plastic.effective_step`."""
        return calling(plastic.effective_step, effective_return=self.effective_return)  # type: ignore[arg-type]

    @cached_property
    def effective_step_small(self) -> FunctionType:
        """:attr:`step_small` by effective stress."""
        return calling(plastic.effective_step_small, effective_return=self.effective_return)  # type: ignore[arg-type]

    @cached_property
    def effective_return(self) -> FunctionType:
        """The return by effective stress that it states, or :func:`runout.physics.plastic.effective_return` with its return."""
        own: Any = self.effective_update
        if own:
            return own  # type: ignore[no-any-return]
        share: Any = plastic.volume_share if self.material.history_is_volume else plastic.history_share
        return calling(plastic.effective_return, law_return=self.update or plastic.law_return, history_share=share)  # type: ignore[arg-type]

    @property
    def laws(self) -> "tuple[Law, ...]":
        """The law itself; of several in one run (:mod:`runout.model.law_mixtures`) all of them."""
        return (self,)

    @cached_property
    def own_functions(self) -> tuple[FunctionType, ...]:
        """Its return mappings and the functions that these call, callees first."""
        return tuple(dict.fromkeys(f for one in self.functions for f in functions_of_law(one)))

    @property
    def depends_on_rate(self) -> bool:
        """Whether the records hold the time step [s], ``time_step``, which the backend updates."""
        return self.material.depends_on_rate

    def set_step(self, table: "np.ndarray", dt: float) -> None:
        """Write the time step [s] to the records of a law that depends on the rate."""
        if self.depends_on_rate:
            table["time_step"] = dt


LAWS: Registry[Law] = Registry("material law", PACKAGE, "runout.laws", MaterialError)


def register_law(material: type[Material], update: Callable[..., Any] | None = None) -> None:
    """Register a material law under the name ``material.law``.

    Parameters
    ----------
    material : type of Material
        Frozen dataclass of keyword-only parameters, each made by a function of :mod:`runout.model.parameters`.
    update : function, optional
        ``update(h, history, mat, effective) -> (h, history, lost)``: Hencky strain [1] of the stress that is left of a trial strain
        ``h``, the history variable, and the energy [J/m3] dissipated per stress-free volume. ``mat`` holds the numbers of
        ``material.record()``. Grains carry the share ``effective`` [1], above 0, of the mean stress, and water the rest; without
        pore pressure it is 1. Plain scalar Python of the shared subset (:mod:`runout.model.registered_law`), compiled for every
        backend. None for a material that never yields. A function without ``effective`` gets strains with the share of the trace,
        which takes longer (:func:`runout.physics.plastic.effective_return`).

    Raises
    ------
    MaterialError
        If the declaration is incomplete or inconsistent, or another law has the name.
    """
    own = _return_mapping(material, update)
    if own and len(inspect.signature(own).parameters) == len(EFFECTIVE_ARGUMENTS):
        law = Law(material.law, material, calling(plastic.dry_return, effective_return=own), own)
    else:
        law = Law(material.law, material, own)
    register(LAWS, law, Material, MaterialError, _require_finite_record)


def _return_mapping(material: type[Material], given: Any) -> FunctionType | None:
    """The function that a law states, of a fitting number of arguments. Raises MaterialError for anything else."""
    if given is None:
        return None
    counts = len(ARGUMENTS), len(EFFECTIVE_ARGUMENTS)
    if not isinstance(given, FunctionType) or len(inspect.signature(given).parameters) not in counts:
        wanted = f"({', '.join(EFFECTIVE_ARGUMENTS)}) or ({', '.join(ARGUMENTS)})"
        raise MaterialError(f"law {material.law}: update must be a plain function of {wanted}, not {given!r}")
    return given


def _require_finite_record(law: Law) -> None:
    """Raise an error unless the record of a law holds finite numbers."""
    for name, value in law.example.record().items():
        if not (name.isidentifier() and math.isfinite(value)):
            raise MaterialError(f"law {law.name}: record() has {name} = {value!r}; finite numbers by name are needed")


def law_of(material: Material) -> Law:
    """The law that a material follows. Raises MaterialError if its class is not registered."""
    return law_followed(LAWS, material, "register_law")

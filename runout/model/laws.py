"""Registry of material laws: each file of :mod:`runout.materials` registers one, which is found by name."""

import inspect
import math
from collections.abc import Callable, Sequence
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
ARGUMENTS = "h", "history", "mat"  # of ``update``: Hencky strain, history variable, record of parameters
EFFECTIVE_ARGUMENTS = *ARGUMENTS, "effective"  # share of the mean stress that grains carry


@dataclass(frozen=True)
class Law(RegisteredLaw[Material]):
    """A registered law of the material."""

    update: FunctionType | None  # return mapping, see :func:`register_law`; None for a material that never yields
    effective_update: FunctionType | None = None  # the same by effective stress, of laws that state it
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
        """Its return mapping, and that by effective stress if it has one of its own."""
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
        """Its own return by effective stress, or :func:`runout.physics.plastic.effective_return` with the return of this law."""
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


def register_law(
    material: type[Material], update: Callable[..., Any] | None = None, effective_update: Callable[..., Any] | None = None
) -> None:
    """Register a material law under the name ``material.law``.

    Parameters
    ----------
    material : type of Material
        Frozen dataclass of keyword-only parameters, each made by a function of :mod:`runout.model.parameters`.
    update : function, optional
        ``update(h, history, mat) -> (h, history, lost)``: Hencky strain [1] of the stress that is left of a trial strain ``h``, the
        history variable, and the energy [J/m3] dissipated per stress-free volume. ``mat`` holds the numbers of
        ``material.record()``. Plain scalar Python of the shared subset (:mod:`runout.model.registered_law`), compiled for every
        backend. None for a material that never yields.
    effective_update : function, optional
        ``effective_update(h, history, mat, effective) -> (h, history, lost)``: the same where grains carry the share ``effective``
        [1], above 0, of the mean stress, and water the rest. Without it, ``update`` gets strains with the share of the trace, which
        takes longer (:func:`runout.physics.plastic.effective_return`).

    Raises
    ------
    MaterialError
        If the declaration is incomplete or inconsistent, or another law has the name.
    """
    own = _function(material, update, "update", ARGUMENTS)
    law = Law(material.law, material, own, _function(material, effective_update, "effective_update", EFFECTIVE_ARGUMENTS))
    register(LAWS, law, Material, MaterialError, _require_finite_record)


def _function(material: type[Material], given: Any, name: str, arguments: Sequence[str]) -> FunctionType | None:
    if given is None:
        return None
    if not isinstance(given, FunctionType) or len(inspect.signature(given).parameters) != len(arguments):
        raise MaterialError(f"law {material.law}: {name} must be a plain function of ({', '.join(arguments)}), not {given!r}")
    return given


def _require_finite_record(law: Law) -> None:
    """Raise an error unless the record of a law holds finite numbers."""
    for name, value in law.example.record().items():
        if not (name.isidentifier() and math.isfinite(value)):
            raise MaterialError(f"law {law.name}: record() has {name} = {value!r}; finite numbers by name are needed")


def law_of(material: Material) -> Law:
    """The law that a material follows. Raises MaterialError if its class is not registered."""
    return law_followed(LAWS, material, "register_law")

"""Several laws in one run: each release follows its own, of the material and of basal friction, in one velocity field.

A mixture is a law for backends. Its records hold the fields of all laws that are in use, by name, and the number of the law that a
record belongs to; its functions call those of that law (:mod:`runout.physics.several_laws`). So kernels are compiled for the laws
in use, and branch by record. A run whose masses follow one law has no mixture.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import FunctionType
from typing import Any, Generic, TypeVar

import numpy as np

from runout.errors import ConfigError, InputError, MaterialError
from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import FrictionLaw
from runout.model.laws import Law, law_of
from runout.model.materials import Material
from runout.model.registered_law import RegisteredLaw, calling, functions_of_law
from runout.physics import contact, plastic, several_laws

NUMBER = "law_number"  # of a record: that of its law among those of the mixture
AND = "_and_"  # between the names of laws in that of a mixture
AnyLaw = TypeVar("AnyLaw", Law, FrictionLaw)


class Mixture(Generic[AnyLaw]):
    """What mixtures of laws of the material and of friction have in common."""

    parts: tuple[AnyLaw, ...]

    @property
    def laws(self) -> tuple[AnyLaw, ...]:
        """The laws; the place of one is its number in records."""
        return self.parts

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """Names of the numbers of a record: those of all laws, each once, and the number of the law."""
        return (*dict.fromkeys(name for law in self.parts for name in law.fields), NUMBER)

    @property
    def is_of_runout(self) -> bool:
        """Whether all laws belong to runout."""
        return all(law.is_of_runout for law in self.parts)

    @cached_property
    def fingerprint(self) -> str:
        """Checksum of those of the laws, and of how they are bound together."""
        own = Path(__file__).read_bytes()
        return hashlib.sha256(" ".join(law.fingerprint for law in self.parts).encode() + own).hexdigest()[:16]


@dataclass(frozen=True)
class LawMixture(Mixture[Law], Law):
    """Laws of the material that masses of one run follow."""

    parts: tuple[Law, ...] = ()  # at least two, ordered by name

    def table(self, materials: tuple[Material, ...], dtype: Any = float, cell_size: float = 1.0) -> np.ndarray:
        """Structured array (materials,) of the records, for cells of ``cell_size`` [m]; 0 where a law has no such number."""
        table = np.zeros(len(materials), [(name, dtype) for name in self.fields])
        for k, material in enumerate(materials):
            law = law_of(material)
            (own,) = law.table((material,), dtype, cell_size)
            for name in law.fields:
                table[name][k] = own[name]
            table[NUMBER][k] = self.parts.index(law)
        return table

    @cached_property
    def own_functions(self) -> tuple[FunctionType, ...]:
        """Functions that branch by record, callees first."""
        branching: Any = self.update, self.effective_return
        return tuple(dict.fromkeys(f for one in branching for f in functions_of_law(one)))

    @cached_property
    def effective_return(self) -> FunctionType:
        """:func:`runout.physics.plastic.effective_return` by record."""
        returns: list[Any] = [law.effective_return for law in self.parts]
        return _by_record(several_laws.own_effective_return, "effective_return", returns)

    @property
    def depends_on_rate(self) -> bool:
        """Whether any law does; then all records hold the time step."""
        return any(law.depends_on_rate for law in self.parts)


@dataclass(frozen=True)
class FrictionMixture(Mixture[FrictionLaw], FrictionLaw):
    """Laws of basal friction that masses of one run follow.

    Ground areas and drag on columns are computed if any law needs them; each law takes what it would take alone.
    """

    parts: tuple[FrictionLaw, ...] = ()  # at least two, ordered by name

    @property
    def uses_area(self) -> bool:
        """Whether any law uses the ground area of a contact."""
        return any(law.uses_area for law in self.parts)

    @property
    def drags_column(self) -> bool:
        """Whether the drag of any law slows whole columns."""
        return any(law.drags_column for law in self.parts)

    @cached_property
    def drags(self) -> bool:
        """Whether the resistance of any law grows with the square of the speed."""
        return any(law.drags for law in self.parts)

    @cached_property
    def example(self) -> BasalFriction:
        """That of the law for which backends hold most."""
        return max(self.parts, key=lambda law: (law.drags_column, law.uses_area)).example

    @cached_property
    def numbers(self) -> tuple[str, ...]:
        """Names of the numbers that zones change, law by law."""
        return tuple(name for law in self.parts for name in law.numbers)

    @cached_property
    def own_functions(self) -> tuple[FunctionType, ...]:
        """Functions that branch by record, callees first."""
        branching = self.resistance, self.limited, self.at_base, self.on_column
        return tuple(dict.fromkeys(f for one in branching for f in functions_of_law(one)))

    @cached_property
    def limited(self) -> FunctionType:
        """:attr:`FrictionLaw.limited` by record."""
        limited: list[Any] = [law.limited for law in self.parts]
        return _resistance_by_record(limited, "limited")

    @cached_property
    def at_base(self) -> FunctionType:
        """:attr:`FrictionLaw.at_base` by record."""
        at_base: list[Any] = [law.at_base for law in self.parts]
        return _resistance_by_record(at_base, "at_base")

    @cached_property
    def on_column(self) -> FunctionType:
        """Resistance by record where that slows whole columns; none for a law whose drag acts at the base."""
        of_laws: list[Any] = [law.resistance if law.drags_column else contact.law_resistance for law in self.parts]
        return _resistance_by_record(of_laws, "on_column")


def material_law(laws: Iterable[Law]) -> Law:
    """The law of the material of a run, or the mixture of those that its masses follow.

    Raises MaterialError if laws cannot be in one run.
    """
    ordered = _ordered(laws)
    return ordered[0] if len(ordered) == 1 else _law_mixture(ordered)


def friction_law(laws: Iterable[FrictionLaw]) -> FrictionLaw:
    """The law of basal friction of a run, or the mixture of those that its masses follow.

    Raises ConfigError if laws cannot be in one run.
    """
    ordered = _ordered(laws)
    return ordered[0] if len(ordered) == 1 else _friction_mixture(ordered)


@cache
def _law_mixture(laws: tuple[Law, ...]) -> LawMixture:
    _require_numbered(laws, MaterialError)
    returns: list[Any] = [law.update or plastic.law_return for law in laws]
    return LawMixture(_name(laws), Material, _by_record(several_laws.own_return, "law_return", returns), parts=laws)


@cache
def _friction_mixture(laws: tuple[FrictionLaw, ...]) -> FrictionMixture:
    _require_numbered(laws, ConfigError)
    resistance = _resistance_by_record([law.resistance for law in laws], "resistance")
    return FrictionMixture(_name(laws), BasalFriction, resistance, laws)


def _by_record(link: Any, called: str, functions: Sequence[Any], name: str | None = None) -> FunctionType:
    """Chain of a function of :mod:`runout.physics.several_laws` that calls, as ``called``, that of the ``functions`` whose place a
    record states."""
    chain = functions[-1]
    for place in reversed(range(len(functions) - 1)):
        chain = calling(link, f"{name or called}_{place}", **{called: functions[place], f"other_{called}": chain, "LAW": place})
        chain.__module__ = __name__  # functions_of_law lists it
    return chain


def _resistance_by_record(functions: Sequence[Any], name: str) -> FunctionType:
    return _by_record(several_laws.own_resistance, "law_resistance", functions, name)


def _ordered(laws: Iterable[AnyLaw]) -> tuple[AnyLaw, ...]:
    return tuple(sorted({law.name: law for law in laws}.values(), key=lambda law: law.name))


def _name(laws: Sequence[RegisteredLaw[Any]]) -> str:
    return AND.join(law.name for law in laws)


def _require_numbered(laws: Sequence[RegisteredLaw[Any]], error: type[InputError]) -> None:
    """Raise an error if a law has a number with the name that records keep for the number of the law."""
    for law in laws:
        if NUMBER in law.fields:  # type: ignore[attr-defined]
            fault = f"law {law.name} has a number {NUMBER}, which is the number of the law where releases follow several"
            raise error(f"{fault}; rename it, or give every release the law {law.name}")

"""A block of site.yaml that names a law: settings made from the declarations of the law."""

import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, Generic, Literal, TypeVar

from pydantic import create_model, model_validator

from runout.config.declared import declared_fields
from runout.config.distributions import Settings, quantity, refuse
from runout.config.wording import choice_fix, shown
from runout.errors import InputError
from runout.model.erosion_laws import ErosionLaw
from runout.model.friction_laws import FrictionLaw
from runout.model.laws import Law
from runout.model.parameters import Parameter
from runout.model.registry import Registry

_WORDS: Any = Literal
AnyLaw = TypeVar("AnyLaw", Law, FrictionLaw, ErosionLaw)


class LawBlock(Generic[AnyLaw]):
    """Settings of the laws of a registry.

    Parameters
    ----------
    registry : Registry
    default : str
        Law of a block that names none.
    base : type of LawSettings
    """

    def __init__(self, registry: Registry[AnyLaw], default: str, base: "type[LawSettings]"):
        self.registry: Registry[AnyLaw] = registry
        self.default, self.base = default, base
        self.settings_of = cache(self._settings_of)

    def _settings_of(self, law: AnyLaw) -> Any:
        """Settings of a block that follows a law."""
        names = ", ".join(self.registry.names())
        default = self.default if law.name == self.default else ...
        return create_model(
            f"{law.declaration.__name__}Settings",
            __base__=self.base,
            __doc__=(law.declaration.__doc__ or "").splitlines()[0],
            law=(_WORDS[law.name], quantity(f"{self.registry.kind}: {names}", default)),
            **declared_fields(law.parameters),
        )

    def law_named_in(self, block: Any) -> str | None:
        """The law that a block names, whether there is one of that name or not; None if it is no block."""
        return block.get("law", self.default) if isinstance(block, dict) else None

    def known_law(self, block: Any) -> AnyLaw | None:
        """The law that a block names; None if there is none."""
        name = self.law_named_in(block)
        return self.registry.find(name) if isinstance(name, str) and name in self.registry.names() else None

    def validated(self, block: Any) -> Any:
        """Settings of a block, of the law that it names."""
        if isinstance(block, self.base):
            return block
        if not isinstance(block, dict):
            raise refuse(f"{shown(block)}; a block is needed", f"write {{law: {self.default}, ...}}")
        name, names = self.law_named_in(block), self.registry.names()
        if name not in names:
            raise refuse(f"{name!r} is not known", choice_fix(name, names), "law")
        try:
            law = self.registry.find(str(name))
        except InputError as error:  # another package that does not work
            message, _, fix = str(error).partition("; ")
            raise refuse(message, fix, "law") from None
        return self.settings_of(law).model_validate(block)


class LawSettings(Settings):
    """A block that names a law: the law and its parameters."""

    law: str

    @classmethod
    def block(cls) -> LawBlock[Any]:
        """The block of site.yaml."""
        raise NotImplementedError

    def with_values(self, values: Mapping[str, float]) -> Any:
        """The law with its parameters; ``values``, by key, replace the stated ones."""
        law = self.block().registry.find(self.law)
        known = {**self.model_dump(exclude={"law"}), **values}
        return law.declaration(**{p.name: known[p.key] for p in law.parameters})

    @model_validator(mode="after")
    def _fits_together(self) -> "LawSettings":
        made(lambda: self.with_values({}), self.block().registry.find(self.law).parameters)
        return self

    def __reduce__(self) -> Any:
        """Pickle the class of the law as well: importing its module registers the law in the other process."""
        block = self.block()
        return _restored, (block.base, block.registry.find(self.law).declaration, self.model_dump())


def _restored(base: type[LawSettings], declaration: Any, values: dict[str, Any]) -> Any:
    block = base.block()
    return block.settings_of(block.registry.find(declaration.law)).model_validate(values)


def made(make: Callable[[], Any], parameters: Iterable[Parameter]) -> Any:
    """What ``make`` gives; its error names the parameters as they are called in site.yaml."""
    try:
        return make()
    except InputError as error:
        text = str(error)
        for p in parameters:
            text = re.sub(rf"\b{p.name}\b", p.key, text)
        message, _, fix = text.partition("; ")
        raise refuse(message, fix) from None

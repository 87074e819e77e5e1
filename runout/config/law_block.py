"""A block of site.yaml that names a law: settings made from the declarations of the law."""

import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Annotated, Any, Generic, Literal, TypeVar

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

    ``default``: law of a block that names none.
    """

    def __init__(self, registry: Registry[AnyLaw], default: str, base: "type[LawSettings]"):
        self.registry: Registry[AnyLaw] = registry
        self.default, self.base = default, base
        self.settings_of = cache(self._settings_of)
        self.own_model = cache(self._own_model_of)

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

    def own_settings(self, block: Any, site: AnyLaw | None, *, attributes: bool = False) -> Any:
        """What a release or a zone states in the place of the site: settings of a law that it names, else numbers by key.

        Parameters
        ----------
        block : object
            A block that names a law is whole; one without a law has some parameters of that of the site.
        site : RegisteredLaw or None
            Law of the site; None if it is not known: that of the parameters counts.
        attributes : bool
            A value may be the name of an attribute, and no law may be named: zones change that of the mass.
        """
        if isinstance(block, self.base) or (isinstance(block, dict) and "law" in block and not attributes):
            return self.validated(block)
        if not isinstance(block, dict):
            raise refuse(f"{shown(block)}; a block is needed", "write {parameter: value, ...}")
        if not block:
            raise refuse("states no parameter", "add one of its law, or remove it")
        model = self.own_model(site or self._law_with(block))
        named = {key for key, value in block.items() if attributes and isinstance(value, str) and key in model.model_fields}
        numbers = model.model_validate({key: value for key, value in block.items() if key not in named})
        empty = next((key for key, value in block.items() if value is None), None)
        if empty is not None:
            raise refuse("has no value; a number is needed", "write it, or remove the key", empty)
        return {key: value if key in named else getattr(numbers, key) for key, value in block.items()}

    def _own_model_of(self, law: AnyLaw) -> type[Settings]:
        """Settings of parameters in the place of those of the site; each may be left out."""
        fields: dict[str, Any] = {}
        for key, (kind, field) in declared_fields(law.parameters).items():
            fields[key] = (Annotated[kind | None, field], None)
        return create_model(f"Own{law.declaration.__name__}", __base__=Settings, **fields)

    def _law_with(self, block: Mapping[str, Any]) -> AnyLaw:
        """The known law that has the parameters of a block; the default where none has."""
        having = (law for law in self.registry.known() if set(block) <= {p.key for p in law.parameters})
        return next(having, self.registry.find(self.default))


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
        message, fix = in_keys(error, parameters)
        raise refuse(message, fix) from None


def in_keys(error: InputError, parameters: Iterable[Parameter]) -> tuple[str, str]:
    """Message and remedy of an error, with the names of parameters as they are in site.yaml."""
    text = str(error)
    for p in parameters:
        text = re.sub(rf"\b{p.name}\b", p.key, text)
    message, _, fix = text.partition("; ")
    return message, fix

"""Converts errors of pydantic into problems in terms of site.yaml: place, value, remedy."""

from collections.abc import Iterable, Mapping
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from runout.config import bed
from runout.config.distributions import DISTRIBUTIONS
from runout.config.document import Document, Location, dotted
from runout.config.friction import BLOCK, KEY, OF_RELEASE, PREFIX, own_model, stated_law
from runout.config.law_block import LawSettings
from runout.config.material import BLOCK as MATERIAL_BLOCK
from runout.config.material import known_law, parameters_model, sampled_ranges, settings_of
from runout.config.release_laws import names_law, own_ranges, stated_laws
from runout.config.release_start import stated_ranges as starts_of
from runout.config.schema import ReleaseSettings, SimulationSettings, SiteSettings
from runout.config.wording import choice_fix, nearest, shown
from runout.errors import Problem
from runout.model.parameters import AUTO

CHOSEN: dict[str, Any] = {f"<{name}>": model for name, model in DISTRIBUTIONS.items()}  # models of the tags of tagged unions
OF_RELEASES: dict[Any, Any] = {"material": MATERIAL_BLOCK, KEY: BLOCK}  # blocks of a release that may have a law of their own
WANTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list such as [1, 2]",
    "dict_type": "a block of `key: value` lines",
    "model_type": "a block of `key: value` lines",
    "finite_number": "a finite number",
}
BOUNDS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
ONE_TRANSFER = "remove the key; use substeps: 4 for less damping"
TAKEN_AWAY = {  # keys of earlier versions, and what to do
    **dict.fromkeys(("transfer", "flip_ratio"), ONE_TRANSFER),
    "f_bar": "remove the key",
    "sleep_speed": "remove the key; masses at rest end a run by stop_when_at_rest",
}
SHAPES = {"<text>": "text", "<list>": "a list", "<block>": "a block {key: value, ...}", "<number>": "a number"}


def problems_of(error: ValidationError, document: Document, whole: type[BaseModel] = SiteSettings) -> list[Problem]:
    """The problems behind a validation error of the model of a ``whole`` file, in the order of the file."""
    problems = [_problem(details, document, whole) for details in error.errors(include_url=False)]
    return sorted(problems, key=lambda p: p.line or 0)


def _problem(details: Mapping[str, Any], document: Document, whole: type[BaseModel]) -> Problem:
    location = tuple(part for part in details["loc"] if not _is_mark(part))
    model, field = _looked_up(details["loc"], document, whole)
    kind, context, value = details["type"], details.get("ctx", {}), details["input"]
    if kind == "runout":
        place = (*location, context["key"]) if context["key"] else location
        return document.problem(place, context["message"], context["fix"])
    if kind == "missing":
        return document.problem(location, "required key is missing", _missing_fix(field))
    if kind == "extra_forbidden":
        fix = _unknown_fix(location, model, document) if whole is SiteSettings else choice_fix(location[-1], model.model_fields)
        return document.problem(location, "unknown key", fix)
    if kind == "union_tag_invalid":
        return _not_chosen(location, context, value, document)
    message, fix = _wrong_value(kind, context, value, details["msg"], field)
    return document.problem(location, message, fix)


def _is_mark(part: Any) -> bool:
    return isinstance(part, str) and part.startswith("<")


def _looked_up(location: Location, document: Document, model: type[BaseModel]) -> tuple[type[BaseModel], FieldInfo | None]:
    """Innermost model of a location in a file of a ``model``, and the field of that model that the location names."""
    of_site = issubclass(model, SiteSettings)
    field: FieldInfo | None = None
    for part in location:
        if _is_mark(part):
            model = CHOSEN.get(str(part), model)
        elif isinstance(part, str):
            field = model.model_fields.get(part)
            inner = inner_model(field.annotation) if field else None
            of_release = _model_of_release(location, part, document) if model is ReleaseSettings else None
            model = of_release or (_model_of_laws(part, model, document) if of_site else None) or inner or model
    return model, field


def _model_of_release(location: Location, part: str, document: Document) -> type[BaseModel] | None:
    """The model of material or friction of a release: of the law that it names, else that of parameters of the site's law."""
    if part not in OF_RELEASES:
        return None
    block, of_site = OF_RELEASES[part], document.value((part,)) or ({} if part == KEY else None)
    own = document.value((*(p for p in location[: location.index(part)] if not _is_mark(p)), part))
    law = block.known_law(own if names_law(own) else of_site)
    if law is None:
        return None
    return block.settings_of(law) if names_law(own) else block.own_model(law)  # type: ignore[no-any-return]


def _model_of_laws(part: str, model: type[BaseModel], document: Document) -> type[BaseModel] | None:
    """The model of a key that depends on the laws of a file; None for any other key."""
    law, friction, erosion = known_law(document.value(("material",))), stated_law(document.values), bed.stated_law(document.values)
    if part == "parameters":
        own = own_ranges(stated_laws(document.values)) | starts_of(document.values)
        return parameters_model(law, friction, erosion, own)
    if part == bed.EROSION and model is bed.BedSettings:
        return bed.BLOCK.settings_of(erosion) if erosion else None  # type: ignore[no-any-return]
    if part == "material":
        return settings_of(law) if law else None
    if part == KEY and friction:
        return BLOCK.settings_of(friction) if model is SiteSettings else own_model(friction)  # type: ignore[no-any-return]
    return None


def inner_model(annotation: Any) -> type[BaseModel] | None:
    """First settings model in the type of a field."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((m for m in map(inner_model, get_args(annotation)) if m), None)


def _missing_fix(field: FieldInfo | None) -> str:
    if field is None:
        return "add it"
    unit = _extra(field, "unit")
    return f"add it: {field.description}" + (f" [{unit}]" if unit else "")


def _unknown_fix(location: Location, model: type[BaseModel], document: Document) -> str:
    word, fields = str(location[-1]), _possible(location, model, document)
    if model is SimulationSettings and word in TAKEN_AWAY:
        return f"it was taken away; {TAKEN_AWAY[word]}"
    if OF_RELEASE in word and _is_sampled(location):
        names = ", ".join(stated_laws(document.values))
        return f"write RELEASE{OF_RELEASE}PARAMETER with a release ({names}) and a parameter of its laws"
    long = word.removeprefix(f"{KEY}_")  # also with the name of the block before it
    near = next((key for key in fields if {PREFIX + word, PREFIX + long, word.removeprefix(PREFIX)} & {key}), None)
    near = near or nearest(word, fields)
    if near:
        return f"did you mean {near!r}?"
    block = OF_RELEASES.get(location[-2]) if len(location) > 1 and not issubclass(model, LawSettings) else None
    laws = _laws_with(word, block.base if block else model)
    if laws:
        return f"it belongs to law: {laws[0]}; state that law, or remove the key"
    inside = [dotted((*location[:-1], key)) for key, inner in _blocks_of(model).items() if word in inner.model_fields]
    if inside and len(location) > 1:
        return f"it belongs under {' or '.join(map(repr, inside))}"
    homes = [section for section, keys in _sections(document).items() if word in keys and _may_move(location, section)]
    if homes:
        return f"it belongs under {homes[0]!r}" if homes[0] else "it belongs to the top of the file, without indentation"
    return f"choose among {', '.join(fields)}"


def _possible(location: Location, model: type[BaseModel], document: Document) -> list[str]:
    """Keys of a model; of sampled parameters only those of the laws of the file."""
    if not _is_sampled(location):
        return list(model.model_fields)
    laws = known_law(document.value(("material",))), stated_law(document.values), bed.stated_law(document.values)
    return list(sampled_ranges(*laws))


def _is_sampled(location: Location) -> bool:
    """Whether a location is that of a parameter that the ensemble or one of its scenarios samples."""
    return len(location) > 2 and location[0] == "ensemble" and location[-2] == "parameters"


def _may_move(location: Location, section: str) -> bool:
    """Whether a key at a location can have slipped out of a section: into the top of the file, or from one block into another.

    The entries of lists, and the blocks inside of other blocks, have keys of common names such as ``file``.
    """
    block = SiteSettings.model_fields.get(section)
    is_list = block is not None and _is_list(block.annotation)
    return len(location) == 1 or (len(location) == 2 and not is_list and (bool(section) or location[-1] != "name"))


def _is_list(annotation: Any) -> bool:
    """Whether a type is a list, or a union with one."""
    return get_origin(annotation) is list or any(_is_list(part) for part in get_args(annotation))


def _blocks_of(model: type[BaseModel]) -> dict[str, type[BaseModel]]:
    """Models of the keys of a model that are blocks or lists of blocks."""
    inner = {key: inner_model(field.annotation) for key, field in model.model_fields.items()}
    return {key: block for key, block in inner.items() if block}


def _laws_with(word: str, model: type[BaseModel]) -> list[str]:
    """Laws of the registry of a block that have a parameter of that key; none for a model that is no such block."""
    known = model.block().registry.known() if issubclass(model, LawSettings) else []
    return [law.name for law in known if word in {p.key for p in law.parameters}]


def _sections(document: Document) -> dict[str, Iterable[str]]:
    inner = {name: inner_model(field.annotation) for name, field in SiteSettings.model_fields.items()}
    fields = {name: model.model_fields for name, model in inner.items() if model}
    law = known_law(document.value(("material",)))
    friction = stated_law(document.values)
    erosion = bed.stated_law(document.values)
    known: dict[str, Iterable[str]] = {"ensemble.parameters": sampled_ranges(law, friction, erosion)}
    if law:
        known["material"] = settings_of(law).model_fields
    if friction and KEY in document.values:
        known[KEY] = BLOCK.settings_of(friction).model_fields
    laws = {name: known[name] for name in ("material", KEY) if name in known}
    return {"": SiteSettings.model_fields, **laws, **{n: keys for n, keys in (fields | known).items() if n not in laws}}


def _not_chosen(location: Location, context: Mapping[str, Any], value: Any, document: Document) -> Problem:
    """Problem of a block whose law, distribution or kind of value is unknown."""
    key = context["discriminator"].removesuffix("()")
    choices = [mark.strip("'") for mark in context["expected_tags"].split(", ")]
    if key == "shape":
        return document.problem(location, f"{shown(value)}; {' or '.join(SHAPES[c] for c in choices)} is needed")
    names = [choice.strip("<>") for choice in choices]
    if not isinstance(value, Mapping):
        return document.problem(location, f"{shown(value)}; a block is needed", f"write {{{key}: {names[0]}, ...}}")
    if key not in value:
        return document.problem((*location, key), "required key is missing", f"choose one of {', '.join(names)}")
    return document.problem((*location, key), f"{value[key]!r} is not known", choice_fix(value[key], names))


def _choices(annotation: Any) -> list[str]:
    """Values of a Literal, also inside a union."""
    inner = get_args(annotation)
    return [c for c in inner if isinstance(c, str)] or [c for part in inner for c in _choices(part)]


def _wrong_value(kind: str, context: Mapping[str, Any], value: Any, text: str, field: FieldInfo | None) -> tuple[str, str]:
    """What is wrong with a value, and the remedy."""
    unit, hint = _extra(field, "unit"), _extra(field, "hint")
    if kind in WANTED:
        word = f" or {AUTO}" if field and field.default == AUTO else ""
        return f"{shown(value)}; {WANTED[kind]}{word} is needed", _number_fix(value, unit)
    if kind == "literal_error" and field:
        return f"{value!r} is not known", choice_fix(value, _choices(field.annotation))
    if any(bound in context for bound in BOUNDS):
        return _out_of_range(context, value, unit, field), hint
    if kind == "string_pattern_mismatch":
        return f"{value!r} cannot be used", hint
    if kind in ("too_short", "too_long"):
        wanted = context.get("min_length", context.get("max_length"))
        return f"a list of {len(value)}; {wanted} {'value is' if wanted == 1 else 'values are'} needed", hint
    if kind == "string_too_short":
        return "is empty", "write a name or remove the key"
    return text[0].lower() + text[1:], hint


def _out_of_range(context: Mapping[str, Any], value: Any, unit: str, field: FieldInfo | None) -> str:
    bounds = {b: getattr(m, b) for m in (field.metadata if field else []) for b in BOUNDS if getattr(m, b, None) is not None}
    bounds |= {b: context[b] for b in BOUNDS if b in context}
    range_ = " and ".join(f"{BOUNDS[b]} {bounds[b]:g}" for b in BOUNDS if b in bounds)
    suffix = f" {unit}" if unit else ""
    digits = next(n for n in (6, 9, 17) if n == 17 or float(f"{value:.{n}g}") == value)  # no value reads as a bound that it passes
    return f"{value:.{digits}g}{suffix} is out of range; it must be {range_}{suffix}"


def _number_fix(value: Any, unit: str) -> str:
    if not isinstance(value, str):
        return ""
    first = value.strip().split(" ")[0]
    if _is_number(value):
        return "remove the quotes"
    if _is_number(first):
        return f"write {first}; the unit is always {unit}" if unit else f"write {first}"
    return f"write {value.replace(',', '.')}" if _is_number(value.replace(",", ".")) else ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _extra(field: FieldInfo | None, key: str) -> str:
    extra = field.json_schema_extra if field else None
    return str(extra.get(key, "")) if isinstance(extra, dict) else ""

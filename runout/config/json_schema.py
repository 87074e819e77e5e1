"""JSON schema of site.yaml for editors, which complete and underline with it.

Pydantic makes it from the settings. Here come the parts that the readers check by functions: the laws, parameters of a release,
sampled parameters, and keys of which one is needed. What needs other files or
several blocks, only ``runout check`` tests.
"""

import json
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from runout.config import bed, friction, material, release_start, scheme
from runout.config.friction import OF_RELEASE
from runout.config.law_block import LawBlock
from runout.config.scenarios import RATES
from runout.config.schema import SiteSettings
from runout.model.limits import Range

FILE = "reasons.yaml"
SCHEMA_FILE = ".site.schema.json"  # beside a site.yaml
SCHEMA = "https://json-schema.org/draft/2020-12/schema"
BLOCKS: dict[str, LawBlock[Any]] = {
    "MaterialSettings": material.BLOCK,
    "FrictionSettings": friction.BLOCK,
    "ErosionSettings": bed.BLOCK,
}
LAWS_IN = {"MaterialSettings": "material", "FrictionSettings": friction.KEY, "ErosionSettings": bed.EROSION}
OWN = {  # parts of site.yaml that hold parameters of a law without its name: model and key, and the block of the law
    ("ReleaseSettings", "material"): "MaterialSettings",
    ("ReleaseSettings", "basal_friction"): "FrictionSettings",
    ("InflowSettings", "material"): "MaterialSettings",
    ("InflowSettings", "basal_friction"): "FrictionSettings",
}
REASONED = {  # blocks of reasons.yaml, by model
    "TerrainSettings": "terrain",
    "ReleaseSettings": "release",
    "PorePressureSettings": "pore_pressure",
    "BedSettings": "bed",
    "SimulationSettings": "simulation",
    "EnsembleSettings": "ensemble",
    "HazardSettings": "hazard",
}
NOT_FOR_EDITORS = ("title", "unit", "hint")  # keywords that pydantic writes


@cache
def reasons() -> dict[str, dict[str, str]]:
    """One line for each key, by block; keys of laws stand under the block that names the law, those of the top under ``site``."""
    from ruamel.yaml import YAML

    table: dict[str, dict[str, str]] = YAML(typ="safe", pure=True).load(files("runout.config").joinpath(FILE).read_text("utf-8"))
    return table


def reason(block: str, key: str) -> str:
    """Why one would change a key of a block; empty for keys of laws of other packages."""
    return reasons().get(block, {}).get(key, "")


def site_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a site.yaml, with descriptions, units, ranges and the names of laws and schemes."""
    schema = SiteSettings.model_json_schema()
    models = schema["$defs"]
    for base, block in BLOCKS.items():
        models |= _laws(block, LAWS_IN[base])
        named = {"law": {"enum": [*block.registry.names()], "description": f"law of {LAWS_IN[base]}"}}  # editors complete from here
        models[base] = {"properties": named, "anyOf": [_ref(block.settings_of(law).__name__) for law in block.registry.known()]}
        models[f"Own{base}"] = _own(block)
    for (model, key), base in OWN.items():
        _replace(models[model]["properties"][key], _ref(f"Own{base}"))
    zone = models["ZoneSettings"]["properties"]["basal_friction"]
    _replace(zone, {"anyOf": [_partial(law, friction.BLOCK, attributes=True) for law in friction.FRICTIONS.known()]})
    of_friction = sorted({p.key for law in friction.FRICTIONS.known() for p in law.parameters})
    rasters = models["TerrainSettings"]["properties"]["friction_rasters"]
    _replace(rasters, {**_object(rasters), "propertyNames": {"enum": of_friction}})
    for model in ("EnsembleSettings", "ScenarioSettings"):
        _sampled(models[model]["properties"]["parameters"], fixed=model == "ScenarioSettings")
    _name_schemes(models["HazardSettings"]["properties"]["scheme"])
    _need_one_of(schema, models)
    _reason(schema, "site")
    for model, name in REASONED.items():
        _reason(models[model], name)
    return {"$schema": SCHEMA, "title": "site.yaml of runout", **_plain(schema)}


def schema_text() -> str:
    """The schema as the text of a file."""
    return json.dumps(site_schema(), ensure_ascii=False, separators=(",", ":")) + "\n"


def _ref(model: str) -> dict[str, str]:
    return {"$ref": f"#/$defs/{model}"}


def _reason(model: dict[str, Any], block: str) -> None:
    """Add to the descriptions of a model why one would change each key."""
    for key, field in model["properties"].items():
        if why := reason(block, key):
            field["why"] = why


def _laws(block: LawBlock[Any], name: str) -> dict[str, Any]:
    """Schema of the settings of each law, by the name of the model."""
    models = [block.settings_of(law) for law in block.registry.known()]
    schemas = {model.__name__: model.model_json_schema() for model in models}
    for schema in schemas.values():
        _reason(schema, name)
    return schemas


def _own(block: LawBlock[Any]) -> dict[str, Any]:
    """A law of its own with all of its parameters, or some parameters of a law that is named elsewhere."""
    laws = block.registry.known()
    named = [{**_ref(block.settings_of(law).__name__), "required": ["law"]} for law in laws]
    return {"anyOf": [*named, *(_partial(law, block) for law in laws)]}


def _partial(law: Any, block: LawBlock[Any], *, attributes: bool = False) -> dict[str, Any]:
    """Some parameters of a law; with ``attributes`` the name of one may stand for a number."""
    properties = block.settings_of(law).model_json_schema()["properties"]
    keys = {key: {k: v for k, v in one.items() if k != "default"} for key, one in properties.items() if key != "law"}
    if attributes:
        text = {"type": "string"}
        keys = {key: {"description": one.get("description", ""), "anyOf": [one, text]} for key, one in keys.items()}
    return {"type": "object", "properties": keys, "additionalProperties": False, "minProperties": 1}


def _object(field: Mapping[str, Any]) -> dict[str, Any]:
    """The part of the schema of a field that is a mapping."""
    return next(dict(one) for one in field.get("anyOf", [field]) if one.get("type") == "object")


def _replace(field: dict[str, Any], content: Mapping[str, Any]) -> None:
    """Give a field another content, or nothing where it may be empty."""
    optional = any(one.get("type") == "null" for one in field.get("anyOf", ()))
    for key in ("anyOf", "type", "additionalProperties", "minProperties", "$ref"):
        field.pop(key, None)
    field |= {"anyOf": [content, {"type": "null"}]} if optional else content


def _sampled(field: dict[str, Any], fixed: bool) -> None:
    """Name the parameters that an ensemble may sample; with ``fixed`` a number may stand for a distribution."""
    distribution = field["additionalProperties"]
    content = {"anyOf": [distribution, {"type": "number"}]} if fixed else distribution
    ranges = material.sampled_ranges()
    own = "|".join([*ranges, *release_start.RANGES])
    field["properties"] = {key: {"description": _allowed(valid), **content} for key, valid in ranges.items()}
    field["patternProperties"] = {rf"^[A-Za-z0-9][A-Za-z0-9_-]*\{OF_RELEASE}({own})$": content}
    field["additionalProperties"] = False


def _allowed(valid: Range) -> str:
    """Range of a sampled parameter as text."""
    unit = f" {valid.unit}" if valid.unit else ""
    return f"distribution of values from {valid.low:g} to {valid.high:g}{unit}"


def _name_schemes(field: dict[str, Any]) -> None:
    file = {"type": "string", "pattern": r"\.ya?ml$", "description": "scheme of your own"}
    field["anyOf"] = [{"enum": scheme.names()}, file, {"type": "null"}]


def _need_one_of(schema: dict[str, Any], models: dict[str, Any]) -> None:
    """Keys of which one is needed, or exactly one."""
    schema["allOf"] = [_one(("basal_friction_angle_deg", "basal_friction")), _any(("release", "inflow"))]
    models["ReleaseSettings"]["allOf"] = [
        _one(("polygons", "raster")),
        _any(("raster", "thickness", "volume")),
        _not_both("basal_friction_angle_deg", "basal_friction"),
        _not_both("raster", "thickness"),
        _not_both("polygons", "sign"),
    ]
    models["InflowSettings"]["allOf"] = [_one(("line", "polygon")), _not_both("polygon", "thickness")]
    models["ZoneSettings"]["allOf"] = [_one(("factor", "basal_friction_angle_deg", "basal_friction"))]
    models["ScenarioSettings"]["allOf"] = [_one(RATES)]
    models["SimulationSettings"]["allOf"] = [_any(("cell_size", "accuracy"))]
    models["BedSettings"]["allOf"] = [_has("depth"), _has("erosion")]


def _has(key: str) -> dict[str, Any]:
    return {"required": [key], "properties": {key: {"not": {"type": "null"}}}}


def _one(keys: Iterable[str]) -> dict[str, Any]:
    return {"oneOf": [_has(key) for key in keys]}


def _any(keys: Iterable[str]) -> dict[str, Any]:
    return {"anyOf": [_has(key) for key in keys]}


def _not_both(a: str, b: str) -> dict[str, Any]:
    return {"not": {"allOf": [_has(a), _has(b)]}}


def _plain(part: Any) -> Any:
    """The schema with units in the descriptions, and without keywords that editors do not know."""
    if isinstance(part, list):
        return [_plain(one) for one in part]
    if not isinstance(part, dict):
        return part
    plain = {key: _plain(value) for key, value in part.items() if key not in NOT_FOR_EDITORS or not isinstance(value, str)}
    if isinstance(part.get("unit"), str) and part["unit"]:
        plain["description"] = f"{part['description']} [{part['unit']}]"
    if isinstance(part.get("why"), str):
        plain["description"] = f"{plain['description']}. Why change it: {plain.pop('why')}"
    if plain.get("default", ...) is None:
        del plain["default"]
    return plain

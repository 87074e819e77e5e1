"""Values that the command line sets in place of those of site.yaml: ``--set KEY=VALUE``.

They are written into the document before it is checked, so that a key, a value or a contradiction is refused as in site.yaml. A
problem of such a key names the option in the place of file and line.
"""

from collections.abc import Iterable
from typing import Any

from runout.config.document import Document, Location, dotted, read_text
from runout.config.wording import choice_fix
from runout.errors import Problem

OPTION = "--set"
FORM = "write KEY=VALUE, such as simulation.cell_size=20, release.scar.thickness=4 or release[0].thickness=4"
SAMPLED = ("ensemble", "parameters")
PREFIXES: dict[Location, str] = {
    (): "",
    ("material",): "",
    ("basal_friction",): "basal_",
}  # of sampled parameters, by the block that states them


class _Refused(Exception):
    """Message and remedy of a key that cannot be set."""


def set_values(document: Document, settings: Iterable[str]) -> None:
    """Write each ``KEY=VALUE`` into a document; what cannot be written is added to its problems.

    A key is dotted; an entry of a list is named by its ``name`` or by its number from 0. A value is YAML. An empty one removes the
    key. A parameter that the ensemble samples is refused, since the sampled values take its place in every member.
    """
    settings = list(settings)
    if not settings:
        return
    if document.values is None:
        document.values = {}
    for setting in settings if isinstance(document.values, dict) else ():
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            document.problems.append(Problem(OPTION, None, "", f"{setting!r} is no setting", FORM))
            continue
        try:
            _set(document, key.strip(), text)
        except _Refused as refusal:
            document.problems.append(Problem(OPTION, None, key.strip(), *refusal.args))
    for place in document.options:
        if (name := _sampled_name(document, place)) is not None:
            fix = f"add --set {dotted((*SAMPLED, name))}= to give all members this value"
            document.problems.append(document.problem(place, "the ensemble samples it, so that this value changes no member", fix))


def _set(document: Document, key: str, text: str) -> None:
    content = read_text(text, OPTION)
    if content.problems:
        raise _Refused(content.problems[0].message, content.problems[0].fix)
    location: Location = ()
    new: Location = ()
    block = document.values
    *parents, last = _parts(document, key)
    for part in parents:
        part = _entry(block, location, part)
        inner = block.get(part) if isinstance(block, dict) else block[part]
        location = (*location, part)
        if inner is None and isinstance(block, dict):
            inner = block[part] = {}
            new = new or location
        block = inner
    last = _entry(block, location, last)
    place = (*location, last)
    if place in document.options:
        raise _Refused("is set twice", "keep one of the two")
    if content.values is None:
        if not isinstance(block, dict) or last not in block:
            raise _Refused("site.yaml does not state this key, so that it cannot be removed", "write a value after the =")
        del block[last]
    else:
        block[last] = content.values
    document.options.add(place)
    if new:
        document.options.add(new)


def _parts(document: Document, key: str) -> list[str]:
    """Parts of a dotted key. RELEASE.PARAMETER is one key of the sampled parameters."""
    parts = key.replace("[", ".").replace("]", "").split(".")
    lists = {key: document.value((key,)) for key in ("release", "inflow")}
    names = [e.get("name", k) for k, entries in lists.items() if isinstance(entries, list) for e in entries if isinstance(e, dict)]
    if tuple(parts[:2]) == SAMPLED and len(parts) > 3 and parts[2] in names:
        parts[2:4] = [".".join(parts[2:4])]
    return parts


def _entry(block: Any, location: Location, part: str) -> Any:
    """Key of a block, or position in a list of the entry with a name or number."""
    if isinstance(block, dict):
        return part
    if not isinstance(block, list):
        raise _Refused(f"{dotted(location)} is {block!r}, which holds no keys", f"set {dotted(location)} as a whole")
    usual = str(location[-1]) if location else ""
    names = [str(entry.get("name", usual)) if isinstance(entry, dict) else "" for entry in block]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(block):
        return int(part)
    known = [name for name in names if name] + list(map(str, range(len(block))))
    raise _Refused(f"{dotted(location)} has no entry {part!r}", choice_fix(part, known))


def _sampled_name(document: Document, place: Location) -> str | None:
    """Key of the sampled parameter that takes the place of a setting; None if there is none."""
    sampled = document.value(SAMPLED)
    if place[:-1] not in PREFIXES or not isinstance(sampled, dict):
        return None
    name = f"{PREFIXES[place[:-1]]}{place[-1]}"
    return name if name in sampled and document.value(place) is not None else None

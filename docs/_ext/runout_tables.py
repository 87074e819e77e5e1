"""Directives that print tables from the code itself, so that they cannot go stale.

``{settings} TerrainSettings`` lists the keys of a block of site.yaml, ``{settings} SiteSettings bulking`` only those named;
``{laws}`` those of the material of every law, ``{friction-laws}`` and ``{erosion-laws}`` those of every friction and erosion law,
``{law-classes}`` their classes, and ``{law-formulas}`` their formulas;
``{variables} max_speed peak_* ...`` lists variables of the products, ``{presets}`` those of accuracy, ``{scores}`` the scores, and
``{processes}`` the published values of each process.
"""

from fnmatch import filter
from typing import Any

from annotated_types import Ge, Gt, Le, Lt
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

BOUNDS = {Ge: ("≥\u00a0{}", "ge"), Gt: (">\u00a0{}", "gt"), Le: ("≤\u00a0{}", "le"), Lt: ("<\u00a0{}", "lt")}


class SettingsTable(SphinxDirective):
    """Table of the keys of a class of :mod:`runout.config.schema`."""

    required_arguments = 1
    optional_arguments = 20

    def run(self) -> list[Any]:
        """Nodes of the table."""
        name, *keys = self.arguments
        fields = _settings_class(name).model_fields
        rows = [_setting_row(key, fields[key]) for key in keys or fields]
        return _table(self, ["key", "unit", "default", "range", "meaning"], rows)


class LawTables(SphinxDirective):
    """For each law of runout what it is, its history variable, and a table of the keys of its material in site.yaml."""

    def run(self) -> list[Any]:
        """Nodes of the tables."""
        from runout.config.material import sampled_ranges, settings_of
        from runout.model.laws import LAWS

        nodes = []
        for law in LAWS.of_runout():
            model, sampled = settings_of(law), sampled_ranges(law)
            history = f" History variable: {law.material.history}." if law.material.history else ""
            nodes += _law_table(self, law.name, model, sampled, history)
        return nodes


class FrictionLawTables(SphinxDirective):
    """For each friction law of runout what it is, and a table of its keys in site.yaml."""

    def run(self) -> list[Any]:
        """Nodes of the tables."""
        from runout.config.friction import BLOCK
        from runout.model.friction_laws import FRICTIONS

        nodes = []
        for law in FRICTIONS.of_runout():
            model, sampled = BLOCK.settings_of(law), {p.key for p in law.parameters if p.sampled}
            nodes += _law_table(self, law.name, model, sampled)
        return nodes


class ErosionLawTables(SphinxDirective):
    """For each erosion law of runout what it is, and a table of its keys in site.yaml."""

    def run(self) -> list[Any]:
        """Nodes of the tables."""
        from runout.config.bed import BLOCK
        from runout.model.erosion_laws import EROSIONS

        nodes = []
        for law in EROSIONS.of_runout():
            model, sampled = BLOCK.settings_of(law), {p.key for p in law.parameters if p.sampled}
            nodes += _law_table(self, law.name, model, sampled)
        return nodes


class LawFormulas(SphinxDirective):
    """What the file of each law of runout says of its formula and its papers."""

    def run(self) -> list[Any]:
        """Nodes of the texts."""
        import inspect

        from runout.model.erosion_laws import EROSIONS
        from runout.model.friction_laws import FRICTIONS
        from runout.model.laws import LAWS

        laws = (*LAWS.of_runout(), *FRICTIONS.of_runout(), *EROSIONS.of_runout())
        text = "\n".join(f"`{law.name}`:\n\n```text\n{inspect.getdoc(inspect.getmodule(law.declaration))}\n```\n" for law in laws)
        return self.parse_text_to_nodes(text)  # type: ignore[no-any-return]


class LawClasses(SphinxDirective):
    """The classes that the files of runout's laws define."""

    def run(self) -> list[Any]:
        """Nodes of their documentation."""
        from runout.model.erosion_laws import EROSIONS
        from runout.model.friction_laws import FRICTIONS
        from runout.model.laws import LAWS
        from runout.model.registered_law import public_names

        names = [*public_names(LAWS), *public_names(FRICTIONS), *public_names(EROSIONS)]
        text = "\n".join(f"```{{eval-rst}}\n.. autoclass:: runout.{name}\n```\n" for name in names)
        return self.parse_text_to_nodes(text)  # type: ignore[no-any-return]


class VariablesTable(SphinxDirective):
    """Table of variables of :mod:`runout.variables`."""

    has_content = True

    def run(self) -> list[Any]:
        """Nodes of the table."""
        from runout.variables import VARIABLES

        names = [name for pattern in " ".join(self.content).split() for name in filter(VARIABLES, pattern) or [pattern]]
        rows = [[f"`{n}`", VARIABLES[n].units, _sentence(VARIABLES[n].long_name, VARIABLES[n].comment)] for n in names]
        return _table(self, ["variable", "unit", "meaning"], rows)


class PresetsTable(SphinxDirective):
    """Table of the presets of :mod:`runout.forecast.accuracy`."""

    def run(self) -> list[Any]:
        """Nodes of the table."""
        from runout.forecast.accuracy import PRESETS, expected_errors

        rows = [
            [
                f"`{name}`",
                f"{p.cells:g}",
                f"{(p.cells / PRESETS['standard'].cells) ** 4:.2g}",
                *(f"± {100 * error:.2g} %" for error in reversed(expected_errors(p.cells))),
            ]
            for name, p in PRESETS.items()
        ]
        heads = ["preset", "cells through the depth", "work", "error of the run-out", "of the thickness map"]
        return _table(self, heads, rows)


class ScoresTable(SphinxDirective):
    """Table of the scores of :mod:`runout.scores`."""

    def run(self) -> list[Any]:
        """Nodes of the table."""
        from runout.scores import DEFINITIONS

        rows = [
            [f"`{name}`", one.units or "of the map", one.range, f"{one.best:g}", one.meaning, one.reference]
            for name, one in DEFINITIONS.items()
        ]
        return _table(self, ["score", "unit", "range", "best", "meaning", "reference"], rows)


class ProcessTables(SphinxDirective):
    """For each process of process_ranges.toml its law, its published values, and the pages that compare runout."""

    def run(self) -> list[Any]:
        """Nodes of the tables."""
        from runout.config.process_ranges import processes

        nodes = []
        for p in processes().values():
            pages = ", ".join(f"[{page}](../validation/{page}.md)" for page in p.compared) or "no case of this process"
            said = f"**{p.title[0].upper()}{p.title[1:]}** (`--process {p.name}`). {p.law} Compared with: {pages}."
            nodes += [*self.parse_text_to_nodes(said), *_ranges_table(self, p.variant)]
            for other in p.others:
                laws = "; ".join(f"`{key}: {_plain(block)}`" for key, block in other.settings.items())
                nodes += [*self.parse_text_to_nodes(f"Or, with {laws}:"), *_ranges_table(self, other)]
        return nodes


class SchemesTable(SphinxDirective):
    """Table of the schemes of danger classes."""

    def run(self) -> list[Any]:
        from runout.config.scheme import names, read_scheme

        schemes = {name: read_scheme(name) for name in names()}
        rows = [
            [f"`{name}`", _classes(scheme), _periods(scheme), ", ".join(scheme.states), scheme.source.title]
            for name, scheme in schemes.items()
        ]
        return _table(self, ["name", "classes", "return periods [a]", "checked", "source"], rows)


def _classes(scheme: Any) -> str:
    return "; ".join(f"{one.name}: {' or '.join(map(str, one.when))} ({one.checked})" for one in scheme.classes)


def _periods(scheme: Any) -> str:
    """Return periods, or levels of individual risk."""
    if scheme.risk:
        return f"individual risk of {', '.join(f'{one:g}' for one in scheme.risk.annual)} a year ({scheme.risk.checked})"
    return f"{', '.join(f'{one:g}' for one in scheme.return_periods.years)} ({scheme.return_periods.checked})"


def _plain(block: Any) -> str:
    """A block of settings on one line."""
    return "{" + ", ".join(f"{k}: {_plain(v)}" for k, v in block.items()) + "}" if isinstance(block, dict) else f"{block}"


def _ranges_table(directive: SphinxDirective, variant: Any) -> list[Any]:
    """Table of the published values of the laws of a process."""
    from runout.config.material import sampled_ranges

    units = {key: valid.unit for key, valid in sampled_ranges().items()}
    rows = [
        [
            f"`{r.key}`",
            " - ".join(f"{v:g}" for v in r.values[::2]),
            f"{r.typical:g}",
            units[r.key],
            r.source,
            f"{r.events}",
            r.checked,
        ]
        for r in variant.ranges
    ]
    return _table(directive, ["parameter", "range", "typical", "unit", "source", "events", "checked"], rows)


def _law_table(directive: SphinxDirective, law: str, model: Any, sampled: Any, history: str = "") -> list[Any]:
    """What a law is, and a table of its keys; ``sampled`` holds those that an ensemble may sample."""
    said = directive.parse_text_to_nodes(f"`law: {law}`. {model.__doc__}{history}")
    rows = [[*_setting_row(name, field), "yes" if name in sampled else ""] for name, field in model.model_fields.items()]
    return [*said, *_table(directive, ["key", "unit", "default", "range", "meaning", "sampled"], rows)]


def _settings_class(name: str) -> Any:
    from runout.config import distributions, fetch, hazard, observations, pore_pressure, probes, release_start, scenarios, schema

    homes = (schema, hazard, distributions, observations, pore_pressure, probes, release_start, fetch, scenarios)
    return next(getattr(home, name) for home in homes if hasattr(home, name))


def _setting_row(name: str, field: Any) -> list[str]:
    extra = field.json_schema_extra or {}
    default = "required" if field.is_required() else _shown(field.default)
    limits = [
        text.format(f"{getattr(m, attribute):g}")
        for m in field.metadata
        for kind, (text, attribute) in BOUNDS.items()
        if isinstance(m, kind)
    ]
    return [f"`{name}`", extra.get("unit", ""), default, ", ".join(limits), field.description]


def _shown(default: Any) -> str:
    if default is None or default == "":
        return "none"
    if default.__class__.__module__.startswith("runout"):
        return "as below"
    return f"`{default}`" if default not in ({}, []) else "none"


def _sentence(name: str, comment: str | None) -> str:
    return f"{name}; {comment}" if comment else name


def _table(directive: Directive, head: list[str], rows: list[list[str]]) -> list[Any]:
    used = [i for i in range(len(head)) if any(row[i] for row in rows)]
    lines = [[head[i] for i in used], ["---"] * len(used), *([row[i] or " " for i in used] for row in rows)]
    text = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
    nodes: list[Any] = directive.parse_text_to_nodes(text)  # type: ignore[attr-defined]
    return nodes


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("settings", SettingsTable)
    app.add_directive("laws", LawTables)
    app.add_directive("friction-laws", FrictionLawTables)
    app.add_directive("erosion-laws", ErosionLawTables)
    app.add_directive("law-classes", LawClasses)
    app.add_directive("law-formulas", LawFormulas)
    app.add_directive("variables", VariablesTable)
    app.add_directive("presets", PresetsTable)
    app.add_directive("scores", ScoresTable)
    app.add_directive("processes", ProcessTables)
    app.add_directive("schemes", SchemesTable)
    return {"parallel_read_safe": True}

"""Every command, option, key of site.yaml and file of the results has a test that names it.

``python tests/test_features.py`` prints the list. Naming is not proof, so only texts of tests count that call or state something:
the fuzz, which calls everything at random, the mutants and the benchmarks do not.
"""

import re
import typing
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from pydantic import BaseModel

from runout import cli
from runout.config.schema import SiteSettings

ROOT = Path(__file__).parents[1]
NOT_COUNTED = ("benchmarks", "mutation", "fuzz")
# Gaps: no test calls the command with the option, though one of the Python interface may cover it. Remove a name that gets a test.
OPTIONS_WITHOUT_TEST = {
    "run": "retry-failed scheduler tls-ca tls-cert tls-key allow-unencrypted slurm",
    "ensemble": "threads retry-failed scheduler tls-ca tls-cert tls-key allow-unencrypted slurm",
    "simulate": "particles",
    "compare": "dem",
    "probe": "points-layer cross-sections-layer threads device",
    "profile": "layer",
    "view": "member frames colour show camera image size device",
    "animate": "colour camera image size fps device",
    "suggest-release": "soil-thickness soil-density transmissivity-recharge samples "
    "sample-seed probability largest-drainage least-area most",
    "calibrate": "retry-failed",
    "scarp": "azimuth outline volume",
    "screen": "erosion-coefficient erodible-thickness grain-diameter",
    "bench": "full device precision",
    "verify": "full precision settled device",
    "stress": "full device",
}  # fmt: skip
KEYS_WITHOUT_TEST = {"probes.cross_sections_layer", "stability.sample_seed", "stability.largest_drainage"}


@cache
def texts() -> dict[str, str]:
    """Texts of the tests by path."""
    files = [path for path in (ROOT / "tests").rglob("*.py") if path.relative_to(ROOT / "tests").parts[0] not in NOT_COUNTED]
    return {path.relative_to(ROOT).as_posix(): path.read_text() for path in files if path != Path(__file__)}


def naming(word: str, pattern: str) -> list[str]:
    """Tests whose text has a pattern, of which a word is part."""
    return [name for name, text in sorted(texts().items()) if word in text and re.search(pattern, text)]


def commands() -> dict[str, list[str]]:
    """Tests of each command: its name is an argument of a call."""
    names = [command.__name__.replace("_", "-") for command in cli.COMMANDS]
    return {name: naming(name, rf"\"{name}\"|runout {name}\b") for name in names}


def options() -> dict[str, list[str]]:
    """Tests of each option of each command: those of the command that name it."""
    found = {}
    for command, tests in commands().items():
        for argument in cli.app[command].assemble_argument_collection():
            names = [name for name in argument.names if name.startswith("--")]
            if argument.parse is not False and argument.field_info.is_keyword_only and names:
                stated = {test for name in names for test in naming(name, rf"[\" ]{name}[ \"=]")}
                found[f"{command} {names[0]}"] = sorted(stated & set(tests))
    return found


def keys_of(model: type[BaseModel], begin: str = "") -> Iterator[str]:
    """Keys of a model and of all models in it, such as ``simulation.cfl``."""
    for key, field in model.model_fields.items():
        yield begin + key
        for inner in dict.fromkeys(models_in(field.annotation)):
            yield from keys_of(inner, f"{begin}{key}.")


def models_in(annotation: object) -> Iterator[type[BaseModel]]:
    """Models that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in typing.get_args(annotation):
        yield from models_in(part)


def keys() -> dict[str, list[str]]:
    """Tests that state each key of site.yaml, or change its value."""
    names = {key: key.split(".")[-1] for key in keys_of(SiteSettings)}
    return {key: naming(name, rf"\b{name}[\"']?\s*[:=]|[\"']{name}[\"']") for key, name in names.items()}


def files() -> dict[str, list[str]]:
    """Tests of each file and folder of the table in docs/guide/outputs.md."""
    table = (ROOT / "docs" / "guide" / "outputs.md").read_text().split("## hazard.nc")[0]
    first = "\n".join(line.split("|")[1] for line in table.splitlines() if line.startswith("| `"))
    names = [name for name in re.findall(r"`([^`]+)`", first) if not name.startswith("*")]
    starts = {name: name.split("/")[0].removeprefix("SITE") for name in names}  # SITE stands for the name of any site
    before = {name: r"\w" if name.startswith("SITE") else r"[\"'/]" for name in names}
    return {name: naming(start, rf"{before[name]}{re.escape(start)}[\"'/]") for name, start in starts.items()}


@pytest.mark.parametrize(
    ("features", "gaps"),
    [
        (commands, set()),
        (options, {f"{command} --{option}" for command, names in OPTIONS_WITHOUT_TEST.items() for option in names.split()}),
        (keys, KEYS_WITHOUT_TEST),
        (files, set()),
    ],
)
def test_every_feature_has_a_test_but_those_that_are_listed(features, gaps):
    found = features()
    assert gaps < found.keys()
    assert {name for name, tests in found.items() if not tests} <= gaps


if __name__ == "__main__":
    for kind in (commands, options, keys, files):
        for name, tests in kind().items():
            print(f"{kind.__name__}\t{name}\t{', '.join(tests) or 'none'}")

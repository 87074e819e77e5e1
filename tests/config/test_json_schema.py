"""The JSON schema of site.yaml: it accepts what the loader accepts, and refuses what is wrong within one block."""

import json
import re
import sys
from pathlib import Path
from random import Random

import jsonschema
import pytest
from ruamel.yaml import YAML

sys.path.append(str(Path(__file__).parents[1] / "fuzz"))
from odd_sites import odd_yaml, site_text, write_good

from runout import cli
from runout.config import bed, friction, material
from runout.config.document import read_text
from runout.config.json_schema import BLOCKS, SCHEMA_FILE, reasons, site_schema
from runout.config.pore_pressure import PorePressureSettings
from runout.config.process_ranges import processes
from runout.config.read import changed_document, checked, load
from runout.config.scaffold import new_site
from runout.config.schema import (
    EnsembleSettings,
    HazardSettings,
    ReleaseSettings,
    SimulationSettings,
    SiteSettings,
    TerrainSettings,
)
from runout.config.scheme import names
from runout.errors import ConfigError, ExitCode

ROOT = Path(__file__).parents[2]
SITES = sorted((ROOT / "sites").glob("*/site.yaml"))
SEEDS = range(60)
NOT_IN_ONE_BLOCK = 0.15  # share of the refused files that only other files or sums over blocks show to be wrong, at most


@pytest.fixture(scope="module")
def schema():
    made = site_schema()
    jsonschema.Draft202012Validator.check_schema(made)
    return jsonschema.Draft202012Validator(made)


def values(text):
    return YAML(typ="safe", pure=True).load(text)


@pytest.mark.parametrize("path", SITES, ids=lambda path: path.parent.name)
def test_the_sites_of_the_repository_are_valid(schema, path):
    assert [error.message for error in schema.iter_errors(values(path.read_text(encoding="utf-8")))] == []


@pytest.mark.parametrize("full", [False, True])
def test_the_site_with_every_block_is_valid(schema, full):
    assert [error.message for error in schema.iter_errors(values(site_text(full=full)))] == []


@pytest.mark.parametrize("process", [None, *processes()])
def test_a_new_site_is_valid_and_names_its_schema(tmp_path, site_folder, schema, process):
    inputs = site_folder / "inputs"
    path = new_site(tmp_path / "made", inputs / "dem.asc", inputs / "release.geojson", "3", process=process)
    text = path.read_text(encoding="utf-8")
    assert text.startswith(f"# yaml-language-server: $schema={SCHEMA_FILE}\n")
    assert json.loads((path.parent / SCHEMA_FILE).read_text(encoding="utf-8")) == schema.schema
    assert [error.message for error in schema.iter_errors(values(text))] == []


GOOD = {  # changes of the site of the fuzzer that the loader accepts
    "a number without a fraction": ("end_time: 3", "end_time: 4"),
    "a word for a number that the run chooses": ("youngs_modulus: 5.0e+6", "youngs_modulus: auto"),
    "an empty block": ("budget: {hours: 100}", "budget:"),
    "three cell sizes": ("cell_size: 10", "cell_size: [10, 10, 5]"),
    "a preset": ("cell_size: 10", "accuracy: screening"),
    "a block of friction": ("basal_friction_angle_deg: 20\nsim", "basal_friction: {friction_angle_deg: 20}\nsim"),
    "empty beside full": ("basal_friction_angle_deg: 20\nsim", "basal_friction_angle_deg: 20\nbasal_friction:\nsim"),
    "a triangular distribution": ("uniform, low: 12, high: 22}", "triangular, low: 12, mode: 15, high: 22}"),
    "parameters of a zone": ("factor: 1.5", "basal_friction: {friction_angle_deg: 25}"),
    "a material of one release": ("    thickness: depth", "    thickness: depth\n    material: {friction_angle_deg: 28}"),
}
BAD = {  # changes that it refuses
    "unknown key": ("density: 2000", "densty: 2000", "densty"),
    "unknown key at the top": ("title: A", "titel: A", "titel"),
    "text for a number": ("density: 2000", "density: heavy", "heavy"),
    "number in quotes": ("end_time: 3", 'end_time: "3"', "3"),
    "boolean for a number": ("end_time: 3", "end_time: true", "True"),
    "out of range": ("friction_angle_deg: 30", "friction_angle_deg: 130", "130"),
    "required key": ("  end_time: 3\n", "", "end_time"),
    "no cell size": ("  cell_size: 10\n", "", "end_time"),
    "unknown law": ("  density: 2000", "  law: jelly\n  density: 2000", "jelly"),
    "parameter of another law": ("  density: 2000", "  density: 2000\n  yield_stress: 5", "yield_stress"),
    "unknown choice": ("placement: on_surface", "placement: beside", "beside"),
    "unknown distribution": ("distribution: uniform, low: 12", "distribution: even, low: 12", "even"),
    "distribution without an end": ("uniform, low: 12, high: 22", "uniform, low: 12", "uniform"),
    "unknown parameter": ("    basal_friction_angle_deg: {", "    basal_angle: {", "basal_angle"),
    "number for a distribution": ("{distribution: uniform, low: 12, high: 22}", "15", "15"),
    "block for a list": ("release:\n", "release: {}\nother:\n", "release"),
    "polygons and raster": ("    raster: inputs", "    polygons: a.gpkg\n    raster: inputs", "polygons"),
    "neither polygons nor raster": ("    raster: inputs/thickness.tif\n", "", "pile"),
    "polygons without a thickness": ("    thickness: depth\n", "", "scar"),
    "two frictions": ("simulation:", "basal_friction: {friction_angle_deg: 20}\nsimulation:", "basal_friction"),
    "no friction": ("basal_friction_angle_deg: 20\nsim", "sim", "basal_friction"),
    "two numbers of a zone": ("factor: 1.5", "factor: 1.5\n      basal_friction_angle_deg: 20", "factor"),
    "empty list": ("percentiles: [50]", "percentiles: []", "[]"),
    "percentile of all": ("percentiles: [50]", "percentiles: [100]", "100"),
    "unknown scheme": ("percentiles: [50]", "percentiles: [50], scheme: swiss", "swiss"),
    "seed with a fraction": ("seed: 1", "seed: 1.5", "1.5"),
    "no members": ("members: 2", "members: 0", "0"),
    "device": ("cell_size: 10", "cell_size: 10\n  device: gpu", "gpu"),
    "name with a blank": ("name: fuzz", "name: a fuzz", "a fuzz"),
}  # fmt: skip


def changed(old, new):
    text = site_text(full=False)
    assert old in text, old
    return text.replace(old, new, 1)


@pytest.fixture(scope="module")
def good_site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    write_good(folder, full=False)
    return folder


@pytest.mark.parametrize("change", GOOD.values(), ids=GOOD)
def test_schema_and_loader_accept_a_good_change(schema, good_site, change):
    document = read_text(changed(*change), "site.yaml")
    assert checked(document, good_site)
    assert [error.message for error in schema.iter_errors(document.values)] == []


@pytest.mark.parametrize("change", BAD.values(), ids=BAD)
def test_schema_and_loader_refuse_a_bad_change(schema, good_site, change):
    *change, word = change
    document = read_text(changed(*change), "site.yaml")
    with pytest.raises(ConfigError):
        checked(document, good_site)
    errors = list(schema.iter_errors(document.values))
    assert any(word in json.dumps([error.message, str(error.instance), list(map(str, error.absolute_path))]) for error in errors), (
        errors
    )


def test_the_schema_underlines_no_odd_site_that_the_loader_reads(tmp_path, schema):
    refused = missed = accepted = 0
    for full in (False, True):
        write_good(tmp_path / str(full), full=full)
        good = (tmp_path / str(full) / "site.yaml").read_bytes()
        for seed in SEEDS:
            odd_yaml(tmp_path / str(full), Random(seed))
            document = changed_document(tmp_path / str(full) / "site.yaml")
            (tmp_path / str(full) / "site.yaml").write_bytes(good)
            if document.problems or not isinstance(document.values, dict):
                continue
            errors = [error.message for error in schema.iter_errors(document.values)]
            try:
                checked(document, tmp_path / str(full))
                accepted += 1
                assert errors == [], seed
            except ConfigError:
                refused, missed = refused + 1, missed + (not errors)
    assert accepted >= 4
    assert refused >= 20
    assert missed <= NOT_IN_ONE_BLOCK * refused


def properties(part):
    """Every property of a schema, with its name."""
    if isinstance(part, dict):
        for name, one in part.get("properties", {}).items() if isinstance(part.get("properties"), dict) else ():
            yield name, one
        for one in part.values():
            yield from properties(one)
    elif isinstance(part, list):
        for one in part:
            yield from properties(one)


def test_every_key_has_a_description_and_no_block_takes_unknown_keys(schema):
    keys = [(name, one) for name, one in properties(schema.schema) if "not" not in one]
    assert len(keys) > 300
    assert [name for name, one in keys if not one.get("description")] == []
    blocks = [schema.schema, *schema.schema["$defs"].values()]
    opened = [
        one.get("title", one) for one in blocks if one.get("type") == "object" and one.get("additionalProperties") is not False
    ]
    assert opened == []


def test_units_laws_processes_and_schemes_are_named(schema):
    models = schema.schema["$defs"]
    assert models["SimulationSettings"]["properties"]["cell_size"]["description"].startswith("grid spacing")
    assert "[m]. Why change it: " in models["SimulationSettings"]["properties"]["cell_size"]["description"]
    for base, block in BLOCKS.items():
        laws = [models[one["$ref"].split("/")[-1]]["properties"]["law"] for one in models[base]["anyOf"]]
        assert {law["const"] for law in laws} == set(block.registry.names())
    assert models["HazardSettings"]["properties"]["scheme"]["anyOf"][0]["enum"] == names()
    sampled = models["EnsembleSettings"]["properties"]["parameters"]
    assert set(sampled["properties"]) == set(material.sampled_ranges())
    assert re.match(next(iter(sampled["patternProperties"])), "scar.basal_mu")


def test_each_key_has_one_line_that_says_why_one_would_change_it(site_folder):
    stated = {
        "site": SiteSettings, "terrain": TerrainSettings, "release": ReleaseSettings, "pore_pressure": PorePressureSettings,
        "simulation": SimulationSettings, "ensemble": EnsembleSettings, "hazard": HazardSettings, "bed": bed.BedSettings,
    }  # fmt: skip
    wanted = {block: set(model.model_fields) for block, model in stated.items()}
    for block, laws in {"material": material.BLOCK, friction.KEY: friction.BLOCK, bed.EROSION: bed.BLOCK}.items():
        own = [law for law in laws.registry.known() if law.is_of_runout]  # other tests register more
        wanted[block] = {"law", *(p.key for law in own for p in law.parameters)}
    lines = {block: set(of_block) for block, of_block in reasons().items()}
    assert {block: lines.get(block, set()) ^ keys for block, keys in wanted.items() if lines.get(block) != keys} == {}
    assert set(lines) == set(wanted)
    assert all(len(line) < 90 and "\n" not in line for lines in reasons().values() for line in lines.values())
    made = new_site(site_folder.parent / "new", site_folder / "inputs" / "dem.asc", site_folder / "inputs" / "release.geojson", "3")
    text = made.read_text(encoding="utf-8")
    assert f"  # Why change it: {reasons()['simulation']['cell_size']}\n  cell_size: 10\n" in text
    assert load(made)


def test_a_site_without_a_process_names_the_published_ranges(tmp_path, site_folder):
    inputs = site_folder / "inputs"
    text = new_site(tmp_path / "made", inputs / "dem.asc", inputs / "release.geojson", "3").read_text(encoding="utf-8")
    comment = " ".join(line.strip().removeprefix("#").strip() for line in text.splitlines())
    assert "No process was chosen" in comment
    for process in processes().values():
        for one in process.of_friction:
            low, high = min(one.values), max(one.values)
            assert f"{one.key} {low:g}{'' if low == high else f' to {high:g}'} ({one.source})" in comment


def test_the_command_prints_the_schema_or_writes_it(tmp_path, schema, capsys, caplog):
    assert cli.main(["schema"]) == ExitCode.OK
    assert json.loads(capsys.readouterr().out) == schema.schema
    with caplog.at_level("INFO"):
        assert cli.main(["schema", "--out", str(tmp_path / "s.json")]) == ExitCode.OK
    assert json.loads((tmp_path / "s.json").read_text(encoding="utf-8")) == schema.schema
    assert "wrote" in caplog.text
    assert cli.main(["schema", "--out", str(tmp_path)]) == ConfigError("").exit_code
    assert "is a folder; name a file in it" in capsys.readouterr().err

"""Version, requirements and citation stand in several files, which agree; a wheel holds all that the package reads."""

import json
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import runout

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OF_CONDA = {"matplotlib": "matplotlib-base"}  # names on conda-forge; all are in lower case


def recipe():
    return YAML(typ="safe").load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text())


def of_conda(requirement):
    """A requirement of pyproject.toml without its marker, as a recipe states it."""
    name, least = re.fullmatch(r"([\w.-]+)(\S+)", requirement.partition(";")[0].strip()).groups()
    return f"{OF_CONDA.get(name.lower(), name.lower())} {least}"


def test_recipe_of_conda_states_the_requirements_of_pyproject():
    stated = recipe()["requirements"]
    python = f"python {PROJECT['requires-python']}"
    assert stated["run"] == [python, *map(of_conda, PROJECT["dependencies"])]
    assert stated["host"][0] == python
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    assert set(map(of_conda, build)) <= set(stated["host"])
    extras = {of_conda(line) for name, lines in PROJECT["optional-dependencies"].items() if name != "test" for line in lines}
    assert set(stated["run_constraints"]) <= extras


def test_recipe_of_conda_has_the_command_of_pyproject():
    assert recipe()["build"]["python"]["entry_points"] == [f"{name} = {place}" for name, place in PROJECT["scripts"].items()]


def test_version_is_that_of_the_package_everywhere():
    citation = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text())
    newest = re.search(r"^## (\S+)", (ROOT / "docs" / "changelog.md").read_text(), re.MULTILINE)
    assert recipe()["context"]["version"] == citation["version"] == newest[1] == runout.__version__


def test_citation_and_metadata_of_the_archive_agree():
    citation = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text())
    archive = json.loads((ROOT / ".zenodo.json").read_text())
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()  # what the format asks for
    assert archive["title"] == citation["title"]
    assert archive["license"] == citation["license"] == PROJECT["license"]
    assert archive["creators"] == citation["authors"]
    assert archive["keywords"] == citation["keywords"]
    assert "doi" not in citation.keys() | archive.keys()  # none is registered yet


def test_wheel_holds_every_file_of_the_package(tmp_path):
    pytest.importorskip("hatchling")
    program = f"from hatchling.build import build_wheel; print(build_wheel({str(tmp_path)!r}))"
    built = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True, timeout=120)
    with zipfile.ZipFile(tmp_path / built.stdout.split()[-1]) as wheel:
        packed = {name for name in wheel.namelist() if name.startswith("runout/")}
    files = {p.relative_to(ROOT).as_posix() for p in (ROOT / "runout").rglob("*") if p.is_file() and "__pycache__" not in p.parts}
    assert files == packed


def test_rattler_build_renders_the_recipe_of_conda():
    rattler_build = pytest.importorskip("rattler_build", reason="needs py-rattler-build, of the extra test")
    text, variants = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text(), rattler_build.VariantConfig()
    (variant,) = rattler_build.Stage0Recipe.from_yaml(text).render(variants, rattler_build.RenderConfig())
    rendered = variant.recipe
    assert (rendered.package.name, str(rendered.package.version)) == ("runout", runout.__version__)
    assert list(map(str, rendered.requirements.run)) == recipe()["requirements"]["run"]
    with pytest.raises(Exception, match="unknown top-level field"):
        rattler_build.Stage0Recipe.from_yaml(f"{text}\nno_such_part: 1\n")

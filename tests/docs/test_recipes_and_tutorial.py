"""Commands and blocks of site.yaml in the recipes and in the tutorial of an event: parsed, validated, and, with the data, run."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from ruamel.yaml import YAML

from runout import cli
from runout.commands.options import TRAITS
from runout.config.schema import SiteSettings

PAGES = ("guide/recipes.md", "event.md", "guide/decision_makers.md", "quickstart.md", "guide/site_yaml/overrides.md")
TASKS = ("mapped deposit", "Two releases", "dam", "cluster", "AvaFrame", "cell size", "doubles", "pressure", "Swiss", "friction")
COARSE = {
    "simulation.cell_size": ["simulation.cell_size=10", "simulation.end_time=20"],
    "ensemble.members": ["ensemble.members=2"],
}
BASE = """
name: mysite
terrain: {dem: inputs/dem.tif}
release: [{name: scar, polygons: inputs/release.gpkg, thickness: 10}]
material: {law: drucker_prager, density: 2000, friction_angle_deg: 34}
basal_friction_angle_deg: 15
simulation: {cell_size: 5, end_time: 60}
"""


def blocks(page: Path, language: str) -> list[str]:
    """Blocks of code of a page in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)


def commands(page: Path) -> list[list[str]]:
    """Calls of runout in the blocks of a page, as lists of arguments."""
    lines = "".join(blocks(page, "bash")).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("runout ")]


@pytest.mark.parametrize("name", PAGES)
def test_every_command_of_a_page_is_one_of_runout_with_its_options(repository, name):
    calls = commands(repository / "docs" / name)
    assert calls or name == "guide/decision_makers.md"
    for arguments in calls:
        cli.app.meta.parse_args(arguments, exit_on_error=False, print_error=False)
        without_out = [a for k, a in enumerate(arguments) if a != "--out" and (k == 0 or arguments[k - 1] != "--out")]
        command, _, _ = cli.app.parse_args(without_out, exit_on_error=False, print_error=False)
        assert command in TRAITS, arguments


def test_every_block_of_the_recipes_is_valid_in_a_site(repository):
    texts = blocks(repository / "docs" / "guide" / "recipes.md", "yaml")
    assert len(texts) >= 5
    for text in texts:
        settings = YAML(typ="safe").load(BASE) | YAML(typ="safe").load(text)
        SiteSettings.model_validate(settings)


def test_recipes_have_five_to_fifteen_lines_and_the_tasks_of_users(repository):
    text = (repository / "docs" / "guide" / "recipes.md").read_text()
    recipes = dict(part.split("\n", 1) for part in text.split("\n## ")[1:])
    for task in TASKS:
        assert any(task in title for title in recipes), task
    for title, recipe in recipes.items():
        assert 5 <= len([line for line in recipe.splitlines() if line.strip()]) <= 22, title


def coarse(arguments: list[str]) -> list[str]:
    """Arguments with cells, end and members that take seconds."""
    return [one for argument in arguments for one in COARSE.get(argument.split("=")[0], [argument])]


def test_the_steps_of_the_event_run_as_they_stand(repository, tmp_path, monkeypatch, rasters_of_cascades):
    calls = commands(repository / "docs" / "event.md")
    assert [arguments[0] for arguments in calls] == ["check", "run", "run"]
    shutil.copytree(repository / "sites" / "cascades_2021", tmp_path / "event", ignore=shutil.ignore_patterns("results"))
    monkeypatch.chdir(tmp_path)
    for arguments in calls:
        assert coarse(arguments) != arguments
        assert cli.main(coarse(arguments)) == 0, arguments
    assert (tmp_path / "coarse" / "report.html").exists()
    with xr.open_dataset(tmp_path / "classes" / "hazard.nc") as hazard:
        assert set(np.unique(hazard["danger_level"])) > {0}
        assert "0.01" in hazard.attrs["scenarios"] or "0.0066" in hazard.attrs["scenarios"]

"""The Snakefile of the guide: its commands are those of runout, and snakemake plans a job for each source."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from runout import cli

CLUSTER = Path(__file__).parents[2] / "docs" / "guide" / "cluster"
TEXT = (CLUSTER / "Snakefile").read_text()


def commands():
    """Commands of the rules, with the wildcards of an example."""
    lines = re.findall(r'f"(runout .*)"$', TEXT, flags=re.MULTILINE)
    shown = {
        "{REGION}": "valley/regional",
        "{{wildcards.name}}": "r001",
        "{{threads}}": "16",
        "{{input}}": "a/hazard.nc b/hazard.nc",
    }
    for word, example in shown.items():
        lines = [line.replace(word, example) for line in lines]
    return [*lines, *re.findall(r"^#   (runout .*)$", TEXT, flags=re.MULTILINE)]


def test_its_commands_are_those_of_runout():
    assert [line.split()[1] for line in commands()] == ["run", "merge", "regional"]
    for line in commands():
        assert "{" not in line
        cli.app.meta.parse_args(line.split()[1:], exit_on_error=False, print_error=False)


def test_its_profile_names_executor_jobs_and_resources():
    profile = YAML(typ="safe").load(CLUSTER / "profile" / "config.yaml")
    assert profile["executor"] == "slurm"
    assert profile["keep-going"] is True
    assert set(profile["default-resources"]) == {"mem_mb", "runtime"}


@pytest.mark.skipif(shutil.which("snakemake") is None, reason="snakemake is not installed")
def test_snakemake_plans_a_job_for_each_source(tmp_path):
    for name in ("r001", "r002"):
        (tmp_path / "regional" / "sources" / name).mkdir(parents=True)
        (tmp_path / "regional" / "sources" / name / "site.yaml").write_text("name: x\n")
    command = ["snakemake", "--snakefile", str(CLUSTER / "Snakefile"), "--directory", str(tmp_path), "--dry-run", "--cores", "1"]
    planned = subprocess.run([*command, "--config", f"region={tmp_path}/regional"], capture_output=True, text=True, check=True)
    assert re.search(r"^source +2$", planned.stdout + planned.stderr, flags=re.MULTILINE)
    assert re.search(r"^merge +1$", planned.stdout + planned.stderr, flags=re.MULTILINE)

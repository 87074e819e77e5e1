"""Odd site files, rasters, vectors, arrays, results and calls of every command: refused or read, never a fault.

RUNOUT_FUZZ=N runs N cases from another seed on, each hundredth with its calibration: some minutes for some thousands.
"""

import os
import resource
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest
from fuzz_cases import run
from odd_commands import odd_call
from odd_sites import site_text, write_good, write_odd_site
from ruamel.yaml import YAML

from runout import cli
from runout.config.bed import BedSettings
from runout.config.inflow import InflowSettings
from runout.config.pore_pressure import PorePressureSettings, RatioSettings
from runout.config.scenarios import ScenarioSettings
from runout.config.schema import EnsembleSettings, SiteSettings
from runout.workflow.check import inspect

PARTS, CASES = 5, 80  # five parts, so that workers of pytest share them
FIRST_OF_FULL = 1_000_000
MEMORY = 6 * 2**30  # [bytes] of addresses that the full run may take


def told(faults) -> str:
    return "\n".join(f"--- seed {fault.seed} ({fault.kind})\n{fault.text}" for fault in faults)


@pytest.mark.parametrize("full", [False, True])
def test_the_site_that_is_made_odd_has_no_problem(tmp_path, full):
    write_good(tmp_path / "site", full=full)
    assert inspect(tmp_path / "site").problems == []


def test_the_site_that_is_made_odd_has_every_block_and_every_command_is_called():
    stated = YAML(typ="safe").load(site_text(full=True))
    assert set(SiteSettings.model_fields) - set(stated) == {"basal_friction"}  # in place of the angle
    assert set(BedSettings.model_fields) - set(stated["bed"]) == {"polygons", "layer"}  # in place of the raster
    pores = [release["pore_pressure"] for release in stated["release"]]
    assert set(PorePressureSettings.model_fields) == {key for pore in pores for key in pore}
    assert set(RatioSettings.model_fields) - {key for pore in pores for key in pore["ratio"]} == {"layer"}
    inflows = {key for one in stated["inflow"] for key in one}
    assert set(InflowSettings.model_fields) - inflows == {"layer", "basal_friction_angle_deg"}  # in place of the law
    scenarios = {key for one in stated["ensemble"]["scenarios"] for key in one}
    assert set(ScenarioSettings.model_fields) == scenarios
    assert set(EnsembleSettings.model_fields) - set(stated["ensemble"]) == {"tolerance", "table"}  # for other ensembles
    called = {odd_call(Random(seed))[0] for seed in range(1000)}
    assert {command.__name__.replace("_", "-") for command in cli.COMMANDS} <= called


@pytest.mark.parametrize("part", range(PARTS))
def test_odd_inputs_are_refused_or_read(part):
    outcomes, faults = run(part * CASES, CASES)
    assert faults == [], told(faults)
    assert outcomes["refused"] > CASES // 2
    assert outcomes["ready"] > CASES // 50


def test_a_seed_gives_the_same_site_every_time(tmp_path):
    written = []
    for place in ("one", "two"):
        for seed in range(1, 9):
            write_odd_site(tmp_path / place / str(seed), seed)
        files = sorted(p for p in (tmp_path / place).rglob("*") if p.suffix in (".yaml", ".geojson", ".tif"))
        written.append([p.read_bytes() for p in files])
    assert written[0] == written[1]


@pytest.mark.skipif("RUNOUT_FUZZ" not in os.environ, reason="the long fuzz runs where RUNOUT_FUZZ names a number of cases")
def test_many_odd_inputs_are_refused_or_read_in_bounded_memory():
    command = [sys.executable, str(Path(__file__).parent / "fuzz_cases.py"), str(FIRST_OF_FULL), os.environ["RUNOUT_FUZZ"], "100"]

    def bounded() -> None:
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))

    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=bounded)
    assert done.returncode == 0, done.stdout + done.stderr

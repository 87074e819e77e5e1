"""The validation's data, and a run of each case at its coarse size."""

import os
from pathlib import Path

import pytest

from runout.studies import validation

FOLDERS = {
    "coulomb_only": "iseesnow/CoulombOnly",
    "idealized_topo": "iseesnow/IdealizedTopo",
    "frank_slide": "frank_slide_1903/shaltop_ref",
    "cascades_2021": "cascades_2021_landlab",
    "cascades_2021_fit": "cascades_2021_landlab",
    "maipo": "maipo_debrisflow_runoptGPP",
    "avakot": "avaframe/avaKot",
    "columns": "bui2008_final_surface.csv",
}


@pytest.fixture(scope="module")
def results():
    """Results of the coarse size of a case, run once; the test is skipped where its data are not at hand."""
    made = {}

    def of(name):
        place = os.environ.get("RUNOUT_DATA")
        if name in FOLDERS and (not place or not (Path(place) / FOLDERS[name]).exists()):
            pytest.skip(f"RUNOUT_DATA names no folder with {FOLDERS[name]}")
        if name not in made:
            made[name] = validation.run(validation.named(name))["results"]
        return made[name]

    return of

"""Each write of a stage fails in turn; the next run makes what an undisturbed one makes.

The usual test takes some writes of the maps, and of each stage where permission is missing, which differs from a full disk in
the message alone. RUNOUT_EVERY_WRITE=1 tries each write: a quarter of an hour.
"""

import os
import shutil
import sys
from pathlib import Path

import pytest

sys.path += [str(Path(__file__).parents[1] / "io"), str(Path(__file__).parent)]
from failing_writes import DENIED, FULL, KILLED, NOT_REACHED, fails, number_of_writes
from test_never_the_wrong_map import assert_same, products

from runout.errors import StorageError
from runout.workflow import hazard_map
from runout.workflow.study import STAGES

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="counts in a copy of this process")
EVERY = "RUNOUT_EVERY_WRITE" in os.environ


@pytest.fixture(scope="module")
def undisturbed(finished_site):
    """Products of the finished site."""
    return products(finished_site[0])


@pytest.mark.parametrize("fault", [FULL, DENIED, KILLED])
@pytest.mark.parametrize("stage", ["terrain", "release", "hazard"])
def test_a_run_heals_whichever_write_of_a_stage_failed(finished_site, undisturbed, tmp_path, stage, fault):
    def copy(name):
        return Path(shutil.copytree(finished_site[0], tmp_path / name))

    counted = copy("counted")
    steps = number_of_writes(lambda: hazard_map.run(counted, stages=(stage,), workers=1, force=True))
    assert steps >= 6  # a folder and a rename for a product, and for the record before and after
    chosen = range(1, steps + 1)
    if not EVERY and fault == DENIED:
        chosen = (1, steps // 2, steps)
    elif not EVERY and stage == "hazard":
        chosen = (1, 3, 4, steps // 2, steps - 2, steps)
    for failing in chosen:
        site = copy(str(failing))
        said = fails(lambda site=site: hazard_map.run(site, stages=(stage,), workers=1, force=True), failing, fault, StorageError)
        assert said in (KILLED, NOT_REACHED) or str(site) in said, failing
        assert said in (KILLED, NOT_REACHED) or ("the disk is full" if fault == FULL else "no permission to write there") in said
        hazard_map.run(site, stages=STAGES[:-1], workers=1)
        assert not list(site.rglob("*.part"))
        assert_same(products(site), undisturbed)
        assert hazard_map.run(site, stages=STAGES[:-1], workers=1).done == ()
        shutil.rmtree(site)

"""A ground is made once for the same elevations, grid and window; any other content makes another one."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from runout import Terrain
from runout.terrain import content_store, crests, sdf
from runout.terrain.crests import Mass


def terrain(bump=0.0):
    z = np.zeros((30, 30))
    z[12:14] = 5.0
    z[3, 3] += bump
    return Terrain.from_array(z, (2.0, 2.0))


@pytest.fixture
def made(monkeypatch):
    """Number of grounds made, from an empty store on."""
    monkeypatch.setattr(sdf, "GROUNDS", content_store.ContentStore(sdf.GROUNDS.size))
    counted = []
    original = sdf._with_crests
    monkeypatch.setattr(sdf, "_with_crests", lambda *given: counted.append(1) or original(*given))
    return counted


def test_same_content_gives_the_same_ground_and_other_content_another_one(made):
    one = sdf.sliding_surface(terrain(), None, (2.0, 2.0))
    assert sdf.sliding_surface(terrain(), np.zeros((30, 30)), (2.0, 2.0)) is one
    assert len(made) == 1
    thickness = np.zeros((30, 30))
    thickness[20:22, 4:6] = 1.0
    others = [
        sdf.sliding_surface(terrain(1e-9), None, (2.0, 2.0)),
        sdf.sliding_surface(terrain(), None, (2.0, 1.5)),
        sdf.sliding_surface(terrain(), thickness, (2.0, 2.0)),
        sdf.sliding_surface(terrain(), None, (2.0, 2.0), Mass(thickness, 0.4)),
    ]
    assert len(made) == 5
    assert len({id(g) for g in others}) == 4


def test_ground_of_a_fluid_is_shared_by_members_whatever_they_sample(made):
    thickness = np.zeros((30, 30))
    thickness[20:22, 4:6] = 1.0
    grounds = {id(sdf.sliding_surface(terrain(), None, (2.0, 2.0), Mass(f * thickness, 0.0))) for f in (0.5, 1.0)}
    assert len(grounds) == len(made) == 1


def test_threads_that_ask_together_wait_for_one_ground(made):
    together = threading.Barrier(4)

    def ask(_):
        together.wait(timeout=60)
        return sdf.sliding_surface(terrain(), None, (2.0, 2.0))

    with ThreadPoolExecutor(4) as pool:
        assert len({id(ground) for ground in pool.map(ask, range(4))}) == 1
    assert len(made) == 1


def test_ground_that_failed_is_made_anew_and_old_ones_are_forgotten(made, monkeypatch):
    def full(*_):
        raise MemoryError

    with monkeypatch.context() as broken:
        broken.setattr(crests, "with_crests", full)
        with pytest.raises(MemoryError):
            sdf.sliding_surface(terrain(), None, (2.0, 2.0))
    first = sdf.sliding_surface(terrain(), None, (2.0, 2.0))
    for k in range(content_store.KEPT):
        sdf.sliding_surface(terrain(k + 1.0), None, (2.0, 2.0))
    again = sdf.sliding_surface(terrain(), None, (2.0, 2.0))
    assert again is not first
    np.testing.assert_array_equal(again.change, first.change)


def test_grounds_of_huge_rasters_are_not_kept_beside_the_last_one(made, monkeypatch):
    monkeypatch.setattr(content_store, "LARGEST", 8 * 30 * 30)
    for bump in (0.0, 1.0, 1.0, 0.0):
        sdf.sliding_surface(terrain(bump), None, (2.0, 2.0))
    assert len(made) == 3

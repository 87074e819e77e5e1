"""Damaged files of members, checkpoints and failures are found or not used; none is a fault of runout."""

import random

import numpy as np
import pytest
import xarray as xr

from runout.ensemble.member import stored_key
from runout.ensemble.status import Failure
from runout.ensemble.written import Written
from runout.io.member_maps import seal
from runout.simulation.checkpoint import Checkpoint, stored_time

ARRAYS = {"run.time": np.array(3.0), "position": np.random.default_rng(0).random((300, 3)), "key": np.array("k" * 64)}


def damaged(content: bytes, choose: random.Random) -> bytes:
    """The content cut off, or with some bytes changed: anywhere, or where headers are."""
    if choose.random() < 0.2:
        return content[: choose.randrange(len(content))]
    changed = bytearray(content)
    for _ in range(choose.choice([1, 1, 3, 20])):
        anywhere, early, late = choose.randrange(len(changed)), choose.randrange(120), len(changed) - 1 - choose.randrange(300)
        changed[choose.choice([anywhere, early, late])] = choose.randrange(256)
    return bytes(changed)


@pytest.mark.filterwarnings("ignore")
def test_a_damaged_checkpoint_is_not_used(tmp_path):
    path, choose = tmp_path / "run.npz", random.Random(1)
    np.savez(path, **ARRAYS)
    whole = path.read_bytes()
    assert stored_time(path) == 3.0
    for _ in range(400):
        path.write_bytes(damaged(whole, choose))
        stored_time(path)
        state = Checkpoint(path, "k" * 64).read()
        assert state is None or all(np.array_equal(state[name], ARRAYS[name]) for name in state)


def test_a_damaged_member_is_found_with_and_without_its_checksum(tmp_path):
    path, choose = tmp_path / "members" / "0000.nc", random.Random(2)
    path.parent.mkdir()
    data = xr.Dataset({"max_speed": (("y", "x"), np.random.default_rng(0).random((40, 50)))}, attrs={"member_key": "k"})
    data = data.assign_coords(x=np.arange(50.0), y=np.arange(40.0))
    data.to_netcdf(path, encoding={"max_speed": {"zlib": True}})
    seal(path)
    whole, written = path.read_bytes(), Written(tmp_path)
    written.note(path, "k")
    written.save()
    assert written.look(path).key == "k"
    for _ in range(150):
        path.write_bytes(damaged(whole, choose))
        assert (written.look(path).fault is None) == (path.read_bytes() == whole)
        if stored_key(path) is not None and Written(tmp_path / "lost").look(path).fault is None:
            xr.testing.assert_identical(xr.load_dataset(path, engine="netcdf4").drop_attrs(), data.drop_attrs())
    path.write_bytes(whole[:-100])
    assert Written(tmp_path).look(path).fault


@pytest.mark.parametrize("content", [b"", b"\xff\xff", b"[", b"[]", b"[" * 100_000, b"{}", b'{"member": 1}', b"5"])
def test_a_damaged_failure_counts_as_none(tmp_path, content):
    path = tmp_path / "0000.failed.json"
    path.write_bytes(content)
    assert Failure.read(path) is None


def test_a_failure_with_a_reason_that_is_no_text_counts_as_none(tmp_path):
    path = tmp_path / "0000.failed.json"
    Failure(0, 5, "KeyError", "k", False).write(path)
    assert Failure.read(path) is None

"""The study of the sampling error: its true error, and its command on a coarse grid."""

import json

import numpy as np
import pytest

from runout.ensemble.design import NetPoints, sobol_points
from runout.hazard import sampling
from tests.benchmarks.sampling_error import main, row_of

POINTS = NetPoints(sobol_points(512, 2, 6), sobol_points(1024, 2, 7))


def test_the_errors_of_independent_members_agree_with_their_formula():
    p, members, rng = 0.3, 512, np.random.default_rng(4)
    reached = (rng.random((4000, members)) < p).astype(np.float32)
    row = row_of(reached, 64, POINTS)
    expected = np.sqrt(p * (1 - p) / 64)
    assert row["blocks"] == 8
    for name, factor in (("stated", sampling.SAFETY), ("true", 1.0), ("independent", 1.0)):
        assert row[name] == pytest.approx(factor * expected, rel=0.08), name
    assert row["holds"]


def test_an_error_that_is_stated_twice_too_large_does_not_hold(monkeypatch):
    edges = np.linspace(0.05, 0.95, 200)  # one parameter decides: the error falls like 1 / n
    values = (POINTS.members[:, 0] < edges[:, None]).astype(np.float32)
    assert row_of(values, 64, POINTS)["holds"]
    monkeypatch.setattr(sampling.Estimator, "factor", lambda *_: 1.0)  # the spread of the blocks as it is
    row = row_of(values, 64, POINTS)
    assert row["ratio"] > 1.5
    assert not row["holds"]


def test_the_command_goes_on_and_writes_table_and_record(tmp_path):
    options = ["--out", str(tmp_path), "--members", "16", "--sizes", "8", "--sites", "jacksboro", "--workers", "1"]
    coarse = ["--set", "simulation.cell_size=120", "simulation.end_time=20"]
    first = main([*options, *coarse])
    assert len(list((tmp_path / "jacksboro" / "members").glob("*.nc"))) == 16
    assert {row["members"] for row in first["rows"]} == {8}
    record = json.loads((tmp_path / "sampling_error.json").read_text())
    assert record["rows"] == first["rows"]
    assert (tmp_path / "sampling_error.md").read_text().count("jacksboro") == len(first["rows"])
    newest = max(path.stat().st_mtime_ns for path in (tmp_path / "jacksboro" / "members").glob("*.nc"))
    main([*options, *coarse])
    assert max(path.stat().st_mtime_ns for path in (tmp_path / "jacksboro" / "members").glob("*.nc")) == newest

"""The ensemble with the real simulation on a tiny slope, in worker processes."""

import re
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from netCDF4 import Dataset

import runout
from runout.config.site import SiteData
from runout.ensemble import workers as worker_processes
from runout.ensemble.member import plan_members
from runout.ensemble.run import run_ensemble
from runout.ensemble.status import standings
from runout.materials.drucker_prager import DruckerPrager
from runout.model.release import Release
from runout.model.terrain import Terrain

SLOPE = 0.5
ANGLES = SimpleNamespace(distribution="discrete", values=[5.0, 25.0], frequencies=[1.0, 1.0])
DENSITY = SimpleNamespace(distribution="discrete", values=[2000.0, -2000.0], frequencies=[3.0, 1.0])


@dataclass(frozen=True)
class SlopeSite:
    """A block on an even slope that falls to the east; one density in four cannot be."""

    folder: Path
    name: str = "slope"
    backend: str = "scan"

    @property
    def settings(self):
        parameters = {"basal_friction_angle_deg": ANGLES, "density": DENSITY}
        ensemble = SimpleNamespace(members=4, seed=1, parameters=parameters)
        return SimpleNamespace(ensemble=ensemble, simulation=SimpleNamespace(device="cpu", backend=self.backend), inflow=None)

    def inputs(self):
        return []

    @property
    def files(self):
        return SimpleNamespace(checksums=list)

    def resolved(self):
        return {"simulation": {"cell_size": 5.0}}

    def computed(self):
        return self.resolved()

    def terrain(self):
        return Terrain(np.tile(100.0 - SLOPE * 5.0 * np.arange(24), (16, 1)), (5.0, 5.0))

    def data(self):
        return SiteData(self.terrain(), (), None)

    def member_arguments(self, sample):
        terrain = self.terrain()
        thickness = np.zeros(terrain.shape)
        thickness[6:10, 4:8] = 5.0
        return {
            "terrain": terrain,
            "release": [Release(thickness, terrain, placement="on_surface")],
            "material": DruckerPrager(density=sample["density"], youngs_modulus=1e6, friction_angle=30.0),
            "basal_friction_angle": sample["basal_friction_angle_deg"],
            "cell_size": 5.0,
            "end_time": 2.0,
            "stop": False,
            "backend": self.backend,
        }


def test_members_of_a_slope_run_faster_with_less_friction_and_bad_ones_are_recorded(tmp_path, monkeypatch):
    monkeypatch.setattr(worker_processes, "core_count", lambda: 2)
    site = SlopeSite(tmp_path)
    report = run_ensemble(site, tmp_path / "results", workers=2)
    speeds = {}
    for member in plan_members(site):
        if member.parameters["density"] < 0:
            assert report.failed[member.number].startswith("density is -2000 kg m-3")
            continue
        assert member.number in report.done
        with Dataset(member.file(tmp_path / "results")) as file:
            speeds.setdefault(member.parameters["basal_friction_angle_deg"], []).append(float(file["max_speed"][:].max()))
    assert len(report.failed) == 1
    assert min(speeds[5.0]) > 1.5 * max(speeds[25.0]) > 0
    assert run_ensemble(site, tmp_path / "results", workers=2).done == ()


@pytest.mark.parametrize("workers", [1, 2])
def test_members_that_share_launches_give_what_each_gives_alone_and_bad_ones_are_recorded(tmp_path, monkeypatch, workers):
    monkeypatch.setattr(worker_processes, "core_count", lambda: 2)
    site, results = SlopeSite(tmp_path, backend="hash"), tmp_path / "results"
    seen = []
    report = run_ensemble(site, results, workers=workers, progress=seen.append)
    (failed,) = report.failed
    assert report.failed[failed].startswith("density is -2000 kg m-3")
    assert len(report.done) == 3
    assert [p.finished for p in seen][-1] == 4
    if workers == 1:  # workers of a cluster tell no more often than twice a second
        assert 0 < max(p.under_way for p in seen if p.finished == 0) <= 4  # the members were told of while they ran
    member = plan_members(site)[report.done[0]]
    alone = runout.simulate(**site.member_arguments(member.parameters), seed=member.seed)
    with Dataset(member.file(results)) as file:
        for name in ("max_speed", "max_flow_thickness", "deposit_thickness"):
            stored = np.ma.filled(file[name][:], np.nan).squeeze()
            expected = np.asarray(alone.maps[name]).squeeze()
            np.testing.assert_allclose(stored, expected, rtol=1e-5, atol=1e-5)
    assert run_ensemble(site, results, workers=1).done == ()


def interrupted(*, checkpoint, progress, **arguments):
    """A simulation that a user ends when it is half done."""

    def end(fraction):
        if fraction > 0.5:
            raise KeyboardInterrupt

    return runout.simulate(**arguments, checkpoint=checkpoint, checkpoint_every=0.0, progress=end)


def everything_of(file):
    """Bytes of all arrays by name but the memory, which is that of the process: restored arrays have no spare room."""

    def arrays(group):
        yield from ((name, variable[:].tobytes()) for name, variable in group.variables.items() if name != "memory")
        for inner in group.groups.values():
            yield from arrays(inner)

    with Dataset(file) as dataset:
        dataset.set_auto_mask(False)
        return dict(arrays(dataset))


def test_a_member_that_was_broken_off_goes_on_from_its_checkpoint(tmp_path):
    site, results = SlopeSite(tmp_path), tmp_path / "results"
    first = next(m for m in plan_members(site) if m.parameters["density"] > 0)
    with pytest.raises(KeyboardInterrupt):
        run_ensemble(site, results, workers=1, simulate=interrupted)
    standing = standings(site, results)[first.number]
    assert standing.state == "left"
    assert re.search(r"kept at 0\.[5-9]", standing.reason)
    assert "a run goes on from there" in standing.reason
    seen = []
    run_ensemble(site, results, workers=1, progress=seen.append)
    assert min(p.fraction for p in seen[1:]) > 0.5 / 4  # it did not start anew
    assert not list((results / "members").glob("*.npz"))
    run_ensemble(site, tmp_path / "whole", workers=1)
    assert everything_of(first.file(results)) == everything_of(first.file(tmp_path / "whole"))

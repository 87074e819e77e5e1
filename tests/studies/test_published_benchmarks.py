"""The published benchmarks: the synthetic site has the stated size, the controls are dense, the page shows what is measured."""

import json

import numpy as np
import pytest

from docs.pages.published import page, tables
from runout.backends.protocol import get_backend
from runout.studies.sloping_layer import Layer
from tests.benchmarks import published_benchmarks
from tests.benchmarks.published_benchmarks import FILE, planned
from tests.benchmarks.seed_cases import bodies, ladder, published, site_runs
from tests.benchmarks.seed_cases import synthetic_site as site
from tests.benchmarks.seed_cases.blocks import count_blocks
from tests.benchmarks.seed_cases.memory_peak import forget_host_peak, host_peak

SLOPES = [published.SLOPES[0], published.SLOPES[-1]]  # [deg]
FRICTION_ANGLES = [published.FRICTION_ANGLES[0], published.FRICTION_ANGLES[-1]]  # [deg]


@pytest.fixture(scope="module")
def ground():
    return site.terrain()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder of the study in its small size, with the least and the largest friction angle and slope."""
    folder = tmp_path_factory.mktemp("published")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bodies, "SLOPES", SLOPES)
        patch.setattr(bodies, "FRICTION_ANGLES", FRICTION_ANGLES)
        published_benchmarks.main([str(folder)])
    return folder


@pytest.fixture(scope="module")
def record(made):
    return json.loads((made / FILE).read_text())


def test_the_site_falls_a_thousand_metres_and_releases_the_stated_volume(ground):
    release = site.release(ground)
    assert release.thickness.sum() * np.prod(ground.cell_size) == pytest.approx(site.VOLUME, rel=1e-12)
    middle = ground.elevation[ground.shape[0] // 2]
    edge = middle[np.flatnonzero(release.thickness.any(axis=0))[0]]
    assert edge - middle.min() == pytest.approx(1000.0, rel=0.1)
    slope = np.abs(np.diff(ground.elevation, axis=1)).max() / ground.cell_size[0]
    assert 30 < np.degrees(np.arctan(slope)) < 45


def test_path_length_counts_from_the_top_of_the_release(ground):
    deposit = np.zeros(ground.shape)
    deposit[:, 200:202] = 1.0  # 2000 to 2020 m from the western edge
    top = site.CROWN + site.CENTRE - site.HALF_AXES[0]
    assert site.path_length(deposit, ground, 0.5) == pytest.approx(2010.0 - top)
    assert site.path_length(deposit, ground, 0.75) == pytest.approx(2015.0 - top)


@pytest.mark.parametrize("name", ["scan", "hash"])
def test_blocks_of_the_dense_index_fill_their_box(name):
    scene, particles = Layer(3000, sparsity=20.0, aligned=True).build()
    found = {}
    for kind in ("sparse", "dense"):
        engine = get_backend(name, "cpu", index=kind)
        engine.load(scene, particles)
        found[kind] = count_blocks(engine)
    assert found["dense"].sparsity < 1.5  # but for the neighbours upwards, which hold the nodes of the last blocks
    assert found["sparse"].sparsity > 4
    assert found["dense"].occupied > 3 * found["sparse"].occupied


def test_a_rung_without_room_for_the_dense_grid_has_the_sparse_part_only(monkeypatch):
    load = ladder.TimedRun

    def refused(case):
        if case.index == "dense":
            raise MemoryError
        return load(case)

    monkeypatch.setattr(ladder, "TimedRun", refused)
    found = ladder.rung(3.0, 2000, "cpu", 1)
    assert "dense" not in found
    assert "speed_up" not in found
    [_, _, (title, table)] = tables([{"device": "cpu", "ladder": [found]}])
    assert title == "Sparsity ladder"
    assert table.count("no room") == 4


def test_memory_peak_falls_back_to_what_the_process_holds():
    held = np.ones(30_000_000)
    peak = host_peak()
    assert peak > held.nbytes
    del held
    forget_host_peak()
    assert host_peak() <= peak


def test_the_record_has_every_part_with_its_rows(record):
    assert [r["slope_deg"] for r in record["slides"]] == SLOPES
    assert [r["friction_angle_deg"] for r in record["collapses"]] == FRICTION_ANGLES
    assert [r["sparsity"] for r in record["ladder"]] == list(ladder.FEW_RUNGS)
    assert [r["cell"] for r in record["site"]] == list(site_runs.COARSE)


def test_the_box_rests_at_14_degrees_and_slides_as_a_rigid_block_above(record):
    rest, *slides = record["slides"]
    assert abs(rest["displacement"]) < 1e-3
    assert all(abs(r["relative_displacement_error"]) < 0.006 for r in slides)


def test_stronger_sand_runs_out_less(record):
    runouts = [r["runout"] for r in record["collapses"]]
    assert runouts == sorted(runouts, reverse=True)
    assert runouts[0] > 1.3 * runouts[-1]


def test_the_flow_keeps_its_mass_and_moves_down_the_path(record):
    assert record["site"]
    for row in record["site"]:
        assert row["mass_error"] < 1e-6
        assert row["runout"] > 2 * site.HALF_AXES[0]
        assert row["sparsity"] > 1
        assert row["nodes"] == 64 * row["blocks"] > 64 * row["active_blocks"] > 0
        assert row["host_bytes"] > row["backend_bytes"] > 100 * row["particles"]


def test_the_page_and_its_tables_are_made_from_the_record(record):
    found = page([record])
    assert "synthetic" in found.text
    assert "small size" in found.text
    for reason in published.NOT_COMPARABLE:
        assert reason[1] in found.text
    assert found.tables["published_ladder.csv"].count("\n") == 1 + len(record["ladder"])
    assert found.pictures["published.png"].startswith(b"\x89PNG")


def test_published_figures_stand_beside_rows_of_the_same_sparsity_and_cell():
    rung = {"sparsity": 373.0, "particles": 10, "speed_up": 3.0, "memory_ratio": 5.0, "measured_sparsity": 380.0}
    rung |= {kind: {"step": 1e-3, "index": 1e-4, "bytes": 10, "blocks": 5} for kind in ("sparse", "dense")}
    [(title, table), (beside, codes), _] = tables([{"device": "cuda:0", "card": "card", "ladder": [rung]}])
    assert beside == "Published code on one card"
    assert "| 10.2 M | 0.212 | 1.34 | 5.25 | 6.3 | 24.8 |" in codes
    assert title == "Beside the published figures"
    assert "| 11.5 | 3.0 (sparsity 380) | GPU |" in table
    assert "| 97 | not measured | CPU |" in table
    [(_, other), *_] = tables([{"device": "cuda:0", "ladder": [rung | {"measured_sparsity": 370.0}]}])
    assert "11.5" not in other


def test_the_dense_control_covers_the_box_of_the_whole_flow(monkeypatch):
    """On warp's CPU device: both grids make the same steps, the dense one over all blocks of the box."""
    monkeypatch.setattr(site_runs, "TURNS", 1)
    monkeypatch.setattr(site_runs, "TRANSFERS", 1)
    low, high = (-1, -1, -3), (8, 5, 4)
    found = site_runs.dense_control(40.0, "cpu", low, high)
    assert found["dense_blocks"] >= np.prod(np.subtract(high, low) + 1) > 3 * found["sparse_blocks"]
    assert found["dense_bytes"] > found["sparse_bytes"]
    assert min(found["dense_seconds"], found["sparse_seconds"]) > 0


def test_a_gpu_runs_the_site_and_the_ladder_only():
    assert list(planned("cuda:0", True)) == ["site", "ladder"]
    assert list(planned("cpu", True)) == ["slides", "collapses", "site", "ladder", "forecasts"]


def test_the_finest_run_fits_a_card_of_16_gb_by_the_forecast(record):
    finest = min(record["forecasts"], key=lambda r: r["cell"])
    assert finest["cell"] == 2.0
    assert finest["particles"] == pytest.approx(8 * site.VOLUME / 2.0**3, rel=0.03)
    assert 100 * finest["particles"] < finest["device_bytes"] < 16e9
    assert finest["host_bytes"] < 4e9

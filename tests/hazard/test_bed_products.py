"""Products over members with an erodible bed, by hand: exceedance, percentiles of both signs, and the share of the bed."""

from pathlib import Path

import numpy as np
import pytest
from synthetic_ensemble import SHAPE, make_terrain, member_maps

from runout.hazard.bed_maps import BedMaps
from runout.hazard.exceedance import aggregate, stated_thresholds
from runout.io import netcdf
from runout.quantities import BED_QUANTITIES

PERCENTILES = [5, 50, 95]
LIMITS = {"thickness": [0.1], "eroded_depth": [0.2, 0.5], "net_erosion": [0.2, 1.0], "net_deposition": [0.3]}
DIFFERENT = pytest.mark.parametrize("weights", [[1, 1, 1, 1], [0.4, 0.3, 0.2, 0.1]])
UNKNOWN = (11, 3)  # a cell that member 2 leaves undefined


def bed_maps(number: int) -> dict[str, np.ndarray]:
    """Maps of member ``number`` at the end of its run: every cell lowered or raised by another amount, or untouched."""
    random = np.random.default_rng(number)
    deposit = member_maps(number)["deposit_thickness"]
    eroded = np.where(random.random(SHAPE) < 0.5, random.uniform(0.0, 1.0, SHAPE), 0.0)
    eroded[:2] = 0.0
    change = np.where(random.random(SHAPE) < 0.8, deposit - 2.0 * eroded, 0.0)
    if number == 2:
        eroded[UNKNOWN] = change[UNKNOWN] = np.nan
    share = np.where(deposit > 0.0, random.random(SHAPE), np.nan)
    return {"eroded_depth": eroded, "elevation_change": change, "bed_share": share}


@pytest.fixture
def members(tmp_path: Path) -> list[Path]:
    """Files of members 0 to 3 with a bed."""
    terrain = make_terrain()
    return [
        netcdf.write(netcdf.map_dataset(terrain, member_maps(n) | bed_maps(n), title="member"), tmp_path / f"{n:04d}.nc")
        for n in range(4)
    ]


def stack(name: str) -> np.ndarray:
    """One map of the four members, (4, rows, columns)."""
    return np.stack([(member_maps(n) | bed_maps(n))[name].astype(np.float32) for n in range(4)])


@DIFFERENT
def test_net_erosion_and_deposition_exceed_their_own_thresholds(members: list[Path], weights: list[float]) -> None:
    maps, w = aggregate(members, weights, LIMITS, PERCENTILES), np.array(weights) / np.sum(weights)
    values = {
        "eroded_depth": stack("eroded_depth"),
        "net_erosion": -stack("elevation_change"),
        "net_deposition": stack("elevation_change"),
    }
    known = ~np.isnan(values["eroded_depth"]).any(axis=0)
    assert not known[UNKNOWN]
    for name, of_members in values.items():
        for k, limit in enumerate(LIMITS[name]):
            p = np.tensordot(w, of_members >= np.float32(limit), axes=1)
            found = maps[f"{name}_exceedance_probability"][k].values
            np.testing.assert_allclose(found[known], p[known], atol=1e-7)
            assert np.isnan(found[UNKNOWN])
            assert p[known].max() > 0.0
            error = np.sqrt(np.clip(p * (1 - p), 0, None) * np.sum(w**2))
            np.testing.assert_allclose(maps[f"{name}_exceedance_standard_error"][k].values[known], error[known], atol=1e-6)
        largest = np.maximum(of_members, 0.0).max(axis=0)
        np.testing.assert_array_equal(maps[f"peak_{name}"].values[known], largest[known])
    assert "net_erosion_percentile" not in maps
    np.testing.assert_allclose(
        maps["mean_eroded_depth"].values[known], np.tensordot(w, values["eroded_depth"], axes=1)[known], atol=1e-6
    )


@DIFFERENT
def test_percentiles_of_the_change_of_elevation_have_both_signs(members: list[Path], weights: list[float]) -> None:
    maps = aggregate(members, weights, LIMITS, PERCENTILES)
    change = stack("elevation_change")
    known = ~np.isnan(change).any(axis=0)
    w = np.broadcast_to(np.reshape(weights, (4, 1, 1)), (4, *SHAPE))
    expected = np.quantile(change, np.array(PERCENTILES) / 100, axis=0, weights=w, method="inverted_cdf")
    found = maps["elevation_change_percentile"].values
    np.testing.assert_array_equal(found[:, known], expected[:, known])
    assert np.isnan(found[:, ~known]).all()
    assert found[0, known].min() < 0.0 < found[2, known].max()
    assert (expected[1][known] == 0.0).any(), "members without a change lie between the others"


@DIFFERENT
def test_share_of_the_bed_weights_members_by_their_deposit(members: list[Path], weights: list[float]) -> None:
    w = np.array(weights) / np.sum(weights)
    of_bed = BedMaps(w)
    maps = aggregate(members, weights, LIMITS, PERCENTILES, each=of_bed.take)
    of_bed.add_to(maps)
    deposit, share = stack("deposit_thickness").astype(float), stack("bed_share").astype(float)
    mass = np.tensordot(w, deposit, axes=1)
    expected = np.tensordot(w, deposit * np.nan_to_num(share), axes=1)
    there = mass > 0.0
    np.testing.assert_allclose(maps["mean_bed_share"].values[there], (expected / np.maximum(mass, 1e-30))[there], rtol=1e-5)
    assert np.isnan(maps["mean_bed_share"].values[~there]).all()
    change = stack("elevation_change")
    known = ~np.isnan(change).any(axis=0)
    mean = maps["mean_elevation_change"].values
    np.testing.assert_allclose(mean[known], np.tensordot(w, change, axes=1)[known], atol=1e-6)
    assert np.isnan(mean[UNKNOWN])


def test_thresholds_of_a_bed_have_their_defaults_on_sites_with_one() -> None:
    class Stated:
        def __getattr__(self, name: str) -> list[float] | None:
            return {"net_erosion_thresholds": [0.25]}.get(name) if name.startswith(("net_", "eroded_")) else [1.0]

    dry, bed = stated_thresholds(Stated()), stated_thresholds(Stated(), bed=True)
    assert not set(dry) & set(BED_QUANTITIES)
    assert bed["net_erosion"] == [0.25]
    assert bed["eroded_depth"] == list(BED_QUANTITIES["eroded_depth"].thresholds)

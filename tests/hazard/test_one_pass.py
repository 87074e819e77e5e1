"""Files of members are opened once, and time, memory and disk follow what is wet and not the raster."""

import errno
import tracemalloc
from collections import Counter
from itertools import product
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import rasterio
import xarray as xr
from synthetic_ensemble import make_site, make_table, make_terrain, member_maps, peaks_of, write_member, write_part

from runout.errors import DiskFullError, StorageError
from runout.hazard import exceedance, tiles
from runout.hazard.exceedance import aggregate
from runout.hazard.products import write_products
from runout.hazard.tiles import TileStore, reached_tiles
from runout.io import member_maps as member_files
from runout.io import netcdf
from runout.io.member_maps import MEMBER_MAPS, STEP, MemberMaps, read_maps
from runout.model.terrain import Terrain

THRESHOLDS = {"thickness": [0.1, 1.0, 2.0], "speed": [1.0, 5.0], "pressure": [3e3, 3e4]}
THRESHOLDS |= {"momentum_flux": [1.0, 10.0], "deposit": [0.5]}
PERCENTILES = [5, 50, 95]
JOINT = [{"thickness": 0.5, "speed": 0.5}]
CELLS = (70, 90)  # of the wet places below


def scene(rows: int, columns: int, offset: tuple[int, int], holes: bool = False) -> Terrain:
    """Flat ground whose cell ``offset`` is at the same place on the map whatever its size."""
    elevation = np.zeros((rows, columns))
    if holes:
        elevation[::7, ::5] = np.nan
    return Terrain(elevation, (5.0, 5.0), -5.0 * offset[1], 5.0 * (offset[0] - rows), None, source="flat")


def flow(terrain: Terrain, offset: tuple[int, int], number: int, cells: tuple[int, int] = CELLS) -> dict[str, np.ndarray]:
    """Maps of a member with irregular values in a place that differs from member to member."""
    rng = np.random.default_rng(number)
    h = np.zeros(terrain.shape)
    row, column = offset[0] + 3 * number, offset[1] + 5 * (number % 3)
    h[row : row + cells[0], column : column + cells[1]] = rng.uniform(0, 4, cells) * (rng.random(cells) > 0.2)
    v = np.sqrt(10 * h)
    arrival = np.where(h > 0, 100 - h, np.nan)
    return {**peaks_of(h, v), "arrival_time": arrival, "deposit_thickness": h / 2}


def members_of(
    folder: Path, terrain: Terrain, offset: tuple[int, int], count: int, parts: bool, cells: tuple[int, int] = CELLS
) -> list[Path]:
    """Files of members as parts or as whole rasters."""
    paths = []
    for number in range(count):
        maps = flow(terrain, offset, number, cells)
        known = {name: terrain.where_known(values) for name, values in maps.items()}
        if parts:
            paths.append(write_part(folder, number, terrain, maps))
        else:
            paths.append(netcdf.write(netcdf.map_dataset(terrain, known, title="m"), folder / f"{number:04d}.nc"))
    return paths


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("weights", [[1] * 6, [1, 2, 3, 4, 5, 6]])
def test_parts_of_the_raster_give_the_same_bits_as_whole_rasters(tmp_path: Path, weights: list[int], holes: bool) -> None:
    terrain = scene(230, 310, (60, 100), holes)
    whole = aggregate(members_of(tmp_path / "whole", terrain, (60, 100), 6, False), weights, THRESHOLDS, PERCENTILES)
    parts = aggregate(members_of(tmp_path / "parts", terrain, (60, 100), 6, True), weights, THRESHOLDS, PERCENTILES)
    assert set(whole.variables) == set(parts.variables)
    for name in whole.variables:
        np.testing.assert_array_equal(parts[name].values, whole[name].values, err_msg=name)
    assert np.isnan(parts["peak_speed"].values).sum() == np.isnan(terrain.elevation).sum()


@pytest.mark.parametrize("weights", [[1] * 6, [1, 2, 3, 4, 5, 6]])
def test_blocks_and_tiles_change_nothing(tmp_path: Path, weights: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    terrain = scene(100, 150, (50, 110))
    paths = members_of(tmp_path, terrain, (50, 110), 6, False, cells=(20, 25))
    plenty = aggregate(paths, weights, THRESHOLDS, PERCENTILES, joint=JOINT)
    monkeypatch.setattr(tiles, "IN_MEMORY", 1)  # all goes through the file
    little = aggregate(paths, weights, THRESHOLDS, PERCENTILES, joint=JOINT, memory_bytes=1)
    for name in plenty.variables:
        np.testing.assert_array_equal(little[name].values, plenty[name].values, err_msg=name)


def test_products_open_the_file_of_each_member_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site, results = make_site(tmp_path)
    opened: Counter[str] = Counter()

    real = netCDF4.Dataset

    class Counting(type):  # no class of its own is derived from that of the library
        def __call__(cls, path, *arguments, **named):
            opened[str(path)] += 1
            return real(path, *arguments, **named)

        def __instancecheck__(cls, instance):
            return isinstance(instance, real)

    class Counted(metaclass=Counting):
        pass

    monkeypatch.setattr(netCDF4, "Dataset", Counted)
    write_products(site, results, make_table(), None)
    assert {path: count for path, count in opened.items() if "/members/" in path} == {
        str(results / "members" / f"000{number}.nc"): 1 for number in range(3)
    }


def test_work_follows_the_wet_cells_and_not_the_raster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells that are read, tiles that are stored and bytes in the temporary file, on a raster and on one of four times its size."""
    read, made = MemberMaps._values, TileStore.finish
    counts: list[Counter[str]] = []

    def counted_read(self, name, rows, columns):
        values = read(self, name, rows, columns)
        counts[-1]["cells"] += values.size
        return values

    def counted_finish(self):
        made(self)
        counts[-1]["tiles"], counts[-1]["bytes"] = len(list(self)), self.end

    monkeypatch.setattr(MemberMaps, "_values", counted_read)
    monkeypatch.setattr(TileStore, "finish", counted_finish)
    for scale in (1, 2):
        counts.append(Counter())
        offset = (64 * 2 * scale, 64 * 3 * scale)
        terrain = scene(300 * scale, 500 * scale, offset)
        paths = members_of(tmp_path / str(scale), terrain, offset, 4, True)
        aggregate(paths, [1] * 4, THRESHOLDS, PERCENTILES)
    assert counts[0] == counts[1]
    assert counts[0]["cells"] <= 4 * len(MEMBER_MAPS) * (CELLS[0] + 2 * STEP) * (CELLS[1] + 2 * STEP)
    assert counts[0]["bytes"] <= 4 * len(MEMBER_MAPS) * 4 * (CELLS[0] + 64) * (CELLS[1] + 64) + 4 * 4 * counts[0]["tiles"]


class Full:
    """In place of a member's file: values above 0 in every cell of a raster, or NaN for the arrival."""

    def __init__(self, path: Path):
        self.part = member_files.Part(0, 0, *(int(number) for number in Path(path).stem.split("x")))

    __enter__, __exit__, known = (lambda self: self), (lambda self, *error: None), (lambda self: None)
    blocks = MemberMaps.blocks

    def held(self):
        return MEMBER_MAPS

    def grid(self):
        return xr.Dataset(coords={"x": np.arange(self.part.columns), "y": np.arange(self.part.rows)})

    def require_grid(self, grid, first):
        """The same always."""

    def _values(self, name, rows, columns):
        shape = (rows.stop - rows.start, columns.stop - columns.start)
        return np.random.default_rng(0).random(shape, np.float32)


@pytest.mark.parametrize(("members", "weights"), [(24, "equal"), (400, "equal"), (150, "different")])
def test_memory_of_an_aggregation_is_bounded_by_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, members: int, weights: str
) -> None:
    """The worst case, beside the maps: all cells wet in all members; about as much on four times the raster."""
    monkeypatch.setattr(exceedance, "MemberMaps", Full)
    monkeypatch.setattr(exceedance, "zeros_by_page", np.zeros)  # which the tracing of memory sees
    memory_bytes = int(1.25 * len(MEMBER_MAPS) * 1024**2)
    aggregate([tmp_path / "64x64"] * 4, [1.0] * 4, THRESHOLDS, PERCENTILES, joint=JOINT, memory_bytes=memory_bytes)  # imports
    extra = []
    for rows, columns in ((64, 64), (64, 256)) if members > 24 else ((256, 256), (512, 512)):
        tracemalloc.start()
        w = [1.0] * members if weights == "equal" else np.arange(1.0, members + 1)
        paths = [tmp_path / f"{rows}x{columns}"] * members
        maps = aggregate(paths, w, THRESHOLDS, PERCENTILES, joint=JOINT, memory_bytes=memory_bytes)
        extra.append(tracemalloc.get_traced_memory()[1] - maps.nbytes)
        tracemalloc.stop()
    assert max(extra) <= memory_bytes
    assert max(extra) >= 0.3 * memory_bytes, "the test would see twice as much"


def test_a_full_disk_is_one_message_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site, results = make_site(tmp_path)
    before = sorted(results.rglob("*"))
    full = Path("/dev/full").open("wb+")  # noqa: SIM115
    monkeypatch.setattr(tiles.tempfile, "SpooledTemporaryFile", lambda **named: full)
    with pytest.raises(DiskFullError, match=r"values of the members: cannot be written \(No space left.*free some space") as caught:
        write_products(site, results, make_table(), None)
    assert getattr(caught.value.__cause__, "errno", None) == errno.ENOSPC
    assert sorted(results.rglob("*")) == before


def test_the_temporary_file_has_no_name_that_could_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "IN_MEMORY", 1)
    with TileStore(tmp_path, 1, 4, 64) as store:
        for member in range(50):
            store.add(member, np.array([3, 5]), np.full((2, 1, 4), member, np.float32))
        assert list(tmp_path.iterdir()) == []
        store.finish()
        assert store.end == 100 * (4 + 16)
        for tile in (3, 5):
            np.testing.assert_array_equal(store.members_of(tile), np.arange(50))
            np.testing.assert_array_equal(store.values_of(tile, 0), np.broadcast_to(np.arange(50), (4, 50)))


def test_tiles_are_those_in_which_a_layer_is_above_zero() -> None:
    layers = [np.zeros((10, 11), np.float32) for _ in range(2)]
    layers[0][5, 6], layers[1][9, 10], layers[1][0, 0] = 1.0, 2.0, np.nan
    rows, columns, values = reached_tiles(layers, 4)
    assert list(zip(rows, columns, strict=True)) == [(1, 1), (2, 2)]
    assert values.shape == (2, 2, 16)
    assert values[0, 0].reshape(4, 4)[1, 2] == 1.0
    assert values[1, 1].reshape(4, 4)[1, 2] == 2.0
    assert values.sum() == 3.0


def test_a_part_is_opened_by_a_gis_in_its_place_and_by_runout_on_the_whole_raster(tmp_path: Path) -> None:
    offset = (130, 200)
    terrain = scene(300, 420, offset, holes=True)
    maps = flow(terrain, offset, 1)
    path = write_part(tmp_path, 1, terrain, maps)
    with rasterio.open(f'NETCDF:"{path}":max_speed') as raster:
        assert raster.shape == (128, 128)
        np.testing.assert_allclose(raster.bounds, terrain.part(slice(128, 256), slice(192, 320)).extent, atol=1e-6)
    whole = read_maps(path)
    for name, values in maps.items():
        np.testing.assert_array_equal(whole[name], terrain.where_known(values).astype(np.float32), err_msg=name)
    np.testing.assert_array_equal(whole["x"], terrain.easting)
    np.testing.assert_array_equal(whole["y"], terrain.northing)


@pytest.mark.parametrize("shape", [(3, 3), (65, 66), (130, 67)])
def test_every_last_cell_of_a_raster_lies_in_a_part(shape: tuple[int, int]) -> None:
    for cell in product(*({*range(3), 62, 63, 64, *range(size - 4, size)} & set(range(size)) for size in shape)):
        wet = np.zeros(shape)
        wet[cell] = 1.0
        part = member_files.reached_part({"max_speed": wet})
        assert wet[part.slices].sum() == 1.0
        assert min(part.rows, part.columns) >= 3
        assert part.row % STEP == part.column % STEP == 0


def test_a_flow_that_never_moves_keeps_the_whole_raster() -> None:
    assert member_files.reached_part({"max_speed": np.zeros((70, 90))}) == member_files.Part(0, 0, 70, 90)


def test_parts_of_another_raster_are_refused(tmp_path: Path) -> None:
    offset = (64, 64)
    one = write_part(tmp_path, 0, scene(200, 200, offset), flow(scene(200, 200, offset), offset, 0))
    larger = scene(264, 264, (128, 128))
    other = write_part(tmp_path, 1, larger, flow(larger, (128, 128), 0))
    with pytest.raises(StorageError, match=r"0001\.nc: its grid \(264 rows, 264 columns\) is not that of 0000\.nc"):
        aggregate([one, other], [1, 1], THRESHOLDS, PERCENTILES)


def test_files_with_parts_and_files_with_whole_rasters_go_together(tmp_path: Path) -> None:
    terrain = make_terrain()
    old = [write_member(tmp_path / "old", number, terrain) for number in range(3)]
    new = [write_part(tmp_path / "new", number, terrain, member_maps(number)) for number in range(3)]
    expected = aggregate(old, [1, 1, 1], THRESHOLDS, PERCENTILES)
    assert not np.isnan(expected["peak_speed"].values[-1, -1]), "these files name no cell without elevation"
    mixed = aggregate([new[0], old[1], new[2]], [1, 1, 1], THRESHOLDS, PERCENTILES)
    for name in (name for name, values in expected.data_vars.items() if values.ndim > 1):
        known = np.isfinite(terrain.elevation)
        np.testing.assert_array_equal(mixed[name].values[..., known], expected[name].values[..., known], err_msg=name)


def test_members_without_a_map_have_the_products_of_the_others_and_no_threshold_of_it(tmp_path: Path) -> None:
    """As files of an earlier version, which had fewer maps."""
    whole, fewer = [], []
    for number in range(3):
        terrain = make_terrain()
        maps = member_maps(number)
        whole.append(netcdf.write(netcdf.map_dataset(terrain, maps, title="test"), tmp_path / f"whole_{number}.nc"))
        maps.pop("max_momentum_flux")
        fewer.append(netcdf.write(netcdf.map_dataset(terrain, maps, title="test"), tmp_path / f"fewer_{number}.nc"))
    limits = {"thickness": [0.1, 1.0], "speed": [1.0]}
    found, expected = (aggregate(paths, np.full(3, 1 / 3), limits, PERCENTILES) for paths in (fewer, whole))
    assert set(expected.data_vars) - set(found.data_vars) == {"peak_momentum_flux", "momentum_flux_percentile"}
    for name in found.data_vars:
        np.testing.assert_array_equal(found[name].values, expected[name].values, err_msg=str(name))
    with pytest.raises(StorageError, match="max_momentum_flux is missing, which thresholds of momentum_flux need"):
        aggregate(fewer, np.full(3, 1 / 3), {**limits, "momentum_flux": [1.0]}, PERCENTILES)
    with pytest.raises(StorageError, match="max_momentum_flux"):
        aggregate([whole[0], *fewer[1:]], np.full(3, 1 / 3), limits, PERCENTILES)

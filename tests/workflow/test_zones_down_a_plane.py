"""Friction zones of a site, as polygons and as rasters: on the grid, and under slabs that follow the closed form over borders."""

import numpy as np
import pytest
import shapely
import xarray as xr
from plane_site import (
    BORDERS,
    CELL,
    COLUMNS,
    COS,
    DOWN,
    FACTOR,
    LENGTH,
    POLYGONS,
    RASTER,
    ROUGH_DEG,
    ROWS,
    SLOPE_DEG,
    START,
    THICKNESS,
    WOOD_DEG,
    down_the_way,
    exact_speeds,
    motion,
    stripe,
    write_raster,
    write_site,
)

import runout
from runout.config.site import read_site
from runout.ensemble.member import plan_members
from runout.model.scene import Raster, Scene
from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.zone_crossing import RIM
from runout.workflow import hazard_map

BOUND = 0.005  # measured: 0.003 at most, in the first metres; 0.0016 over the borders
DRAG_BOUND = 0.022  # measured: 0.019 with rasters, whose borders are steps of the cells, 0.013 with polygons
MU, XI = (0.1, 0.35, 0.2), (600.0, 200.0, 900.0)
VOELLMY_POLYGONS = f"""
  friction_zones:
    - {{polygons: inputs/rough.gpkg, basal_friction: {{mu: {MU[1]}, xi: {XI[1]}}}}}
    - {{polygons: inputs/wood.gpkg, basal_friction: {{mu: {MU[2]}, xi: {XI[2]}}}}}"""
VOELLMY_RASTERS = """
  friction_rasters: {mu: inputs/mu.tif, xi: inputs/xi.tif}"""
ROUGH, WOOD = (np.tan(np.radians(angle)) for angle in (ROUGH_DEG, WOOD_DEG))


def frictions(zones, angle):
    """Coulomb coefficients of the three zones for a mass with a friction angle [deg] of its own."""
    own = float(np.tan(np.radians(angle)))
    return own, float(ROUGH), float(FACTOR * own if zones is POLYGONS else WOOD)


def largest_error(speed, exact, way):
    """Largest relative error of speeds (n,) after the first 5 m of ways (n,)."""
    later = way > 5.0
    return np.abs(speed[later] / exact[later] - 1.0).max()


def table_of(arguments):
    """Numbers (rows, columns) that contact reads for the first release, northernmost row first."""
    terrain = arguments["terrain"]
    law = arguments.get("basal_friction") or float(np.tan(np.radians(arguments["basal_friction_angle"])))
    raster, material = Raster(*terrain.shape, terrain.cell_size), arguments["material"]
    basal = Scene((1.0, 1.0, 1.0), None, raster, (material,), (law,), friction_zones=arguments["friction_zones"]).basal
    return basal.table()[basal.kind].T[::-1]


def shares():
    """Shares (3, rows, columns) of the three zones in the area of each cell."""
    east, north = CELL * np.arange(COLUMNS), CELL * np.arange(ROWS)[::-1, None]
    cells = shapely.box(east, north, east + CELL, north + CELL)
    parts = (stripe(-500.0, BORDERS[0]), stripe(*BORDERS), stripe(BORDERS[1], 500.0))
    return np.array([shapely.area(shapely.intersection(cells, part)) for part in parts]) / CELL**2


def test_polygons_and_raster_state_one_friction_on_cells_that_no_border_cuts(tmp_path):
    """Cells that a border cuts have the mean by area of polygons, and the value at their centre of a raster."""
    polygons, raster = (
        table_of(read_site(write_site(tmp_path / name, zones)).member_arguments({"basal_friction_angle_deg": 10.0}))["friction"]
        for name, zones in (("polygons", POLYGONS), ("raster", RASTER))
    )
    covered = shares()
    np.testing.assert_allclose(polygons, np.tensordot(frictions(POLYGONS, 10.0), covered, 1), rtol=1e-9)
    centre = np.searchsorted(BORDERS, down_the_way())
    np.testing.assert_allclose(raster, np.array(frictions(RASTER, 10.0))[centre], rtol=1e-9)
    whole = covered.max(axis=0) > 1 - 1e-9
    assert 100 < (~whole).sum() < 0.1 * whole.size
    same = whole & (centre < 2)  # the third zone is a factor as polygon
    np.testing.assert_allclose(polygons[same], raster[same], rtol=1e-9)


@pytest.mark.parametrize("zones", [POLYGONS, RASTER], ids=["polygons", "raster"])
def test_each_member_of_a_run_follows_the_closed_form_of_its_own_row_of_the_table(tmp_path, zones):
    """The friction of a member counts where no zone replaces it, and times the factor of a zone."""
    folder = write_site(tmp_path / "plane", zones, (8, 11))
    hazard_map.run(folder, stages=("terrain", "release", "ensemble"), workers=1, threads=1)
    site = read_site(folder)
    angles = []
    for member in plan_members(site):
        angle = member.parameters["basal_friction_angle_deg"]
        angles.append(angle)
        own = frictions(zones, angle)
        found = table_of(site.member_arguments(member.parameters))["friction"]
        for number, share in enumerate(shares()):
            np.testing.assert_allclose(found[share > 1 - 1e-9], own[number], rtol=1e-9)
        with xr.open_dataset(member.file(folder / "results"), group="ledger") as ledger:
            way, speed = motion(ledger)
        assert way[-1] * COS > BORDERS[1]  # the rear of the slab, which starts at 0, has left the second zone
        assert largest_error(speed, exact_speeds(own, way), way) < BOUND
        other = frictions(zones, 19.0 - angle)  # the negative control: the friction of the other member
        assert largest_error(speed, exact_speeds(other, way), way) > 5 * BOUND
    assert sorted(angles) == [8, 11]


def test_polygons_and_their_raster_move_a_slab_alike_within_the_width_of_a_cell(tmp_path):
    """Wood of one friction in both; a border a cell aside would change the speed by ``cell`` [m/s]."""
    alike = POLYGONS.replace("factor: factor", f"basal_friction_angle_deg: {WOOD_DEG:g}")
    motions = [motion(_run(write_site(tmp_path / name, zones)).series) for name, zones in (("p", alike), ("r", RASTER))]
    way = np.linspace(10.0, min(places[-1] for places, _ in motions), 50)
    polygons, raster = (np.interp(way, *found) for found in motions)
    exact = exact_speeds(frictions(RASTER, 10.0), np.append(0.0, way))[1:]
    for found in (polygons, raster):
        assert np.abs(found / exact - 1.0).max() < BOUND
    steps = np.abs(np.diff(frictions(RASTER, 10.0)))
    cell = GRAVITY * steps.sum() * CELL * np.abs(DOWN).sum() / exact[-1]  # g cos dmu w / v, w the width of a cell along the slope
    assert 0.0 < np.abs(polygons - raster).max() < 0.1 * cell  # measured: 0.02


@pytest.mark.parametrize("backend", ["scan", "hash"])
def test_zones_change_the_friction_of_each_release(tmp_path, backend):
    """Two slabs side by side, one with an angle of its own: a zone replaces both, and its factor multiplies that of each."""
    slabs = {"own": (8.0, 24.0, "    basal_friction_angle_deg: 6\n"), "usual": (-24.0, -8.0, "")}
    for time in (8.0, 12.0)[backend == "hash" :]:  # on both sides of a border, and behind all of them
        sampled = {"sampled": "release_volume_factor", "values": [1]}  # an angle that members sample counts for all releases
        result = _run(write_site(tmp_path / f"{time:g}", slabs=slabs, backend=backend, time=time, **sampled))
        p, middle = result.state, LENGTH / 2
        fall = np.array([*DOWN * COS, -np.sin(np.radians(SLOPE_DEG))])
        for release, angle in enumerate((6.0, 10.0)):
            mine = p.release == release
            place = p.position(np.array(result.spacing))[mine, :2].mean(axis=0) - START
            way = np.array([0.0, (place @ DOWN - middle) / COS])
            expected = exact_speeds(frictions(POLYGONS, angle), way)[-1]
            assert p.velocity[mine].mean(axis=0) @ fall == pytest.approx(expected, rel=BOUND)


@pytest.mark.parametrize("zones", [VOELLMY_POLYGONS, VOELLMY_RASTERS], ids=["polygons", "rasters"])
def test_voellmy_zones_brake_a_slab_as_the_closed_form_says(tmp_path, zones):
    """mu and xi of each zone; where a border cuts a cell, polygons mix mu and 1/xi by area."""
    law = f"basal_friction: {{law: voellmy, mu: {MU[0]}, xi: {XI[0]:g}}}"
    chosen = {"friction": law, "sampled": "basal_mu", "values": [MU[0]], "time": 14.0}
    folder = write_site(tmp_path / "plane", zones, **chosen)
    centre = np.searchsorted(BORDERS, down_the_way())
    for name, values in (("mu", MU), ("xi", XI)):
        write_raster(folder / "inputs" / f"{name}.tif", np.array([np.nan, *values[1:]])[centre])
    site = read_site(folder)
    found, drag = table_of(site.member_arguments({"basal_mu": MU[0]})), 2000.0 * GRAVITY / np.array(XI)
    for name, values in (("mu", np.array(MU)), ("drag", drag)):
        mean = np.tensordot(values, shares(), 1) if zones is VOELLMY_POLYGONS else values[centre]
        np.testing.assert_allclose(found[name], mean, rtol=1e-9)
    result = _run(folder)
    way, speed = motion(result.series)
    length, width, h = LENGTH / COS, 24.0, result.spacing[0]
    rim = 2.0 * RIM * h * np.abs(DOWN).sum()  # of both sides; wider where it is oblique to the grid
    area = (1.0 + rim / length) * (1.0 + rim / width)
    exact = exact_speeds(MU, way, tuple(GRAVITY * area / (xi * THICKNESS * COS) for xi in XI))
    assert largest_error(speed, exact, way) < DRAG_BOUND
    assert speed[-1] < 0.7 * speed.max()  # xi of the second zone brakes it


def _run(folder):
    site = read_site(folder)
    return runout.simulate(**site.member_arguments(plan_members(site)[0].parameters), threads=1)

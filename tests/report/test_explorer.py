"""The interactive map of the report: its values are those of the products, and it works in a browser without a network."""

import base64
import gzip
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
import xarray as xr
from browser import READY, Page

from runout.errors import InputError
from runout.report import explorer as explorer_module
from runout.report.explorer import explorer
from runout.report.explorer_layers import Grid, families, round_step, step_of
from runout.report.marks import Mark
from runout.report.study import read_study
from runout.variables import VARIABLES

EVIL = "</script><img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def study(results):
    """The invented valley."""
    return read_study(results)


@pytest.fixture(scope="module")
def made(study, site):
    """Its explorer."""
    return explorer(study, site.resolved())


def unpacked(head, name):
    """Content of a script element."""
    return gzip.decompress(base64.b64decode(re.search(rf'id="{name}">([^<]*)<', head)[1]))


def content_of(made):
    """What the browser reads: the description, and the values (levels, rows, columns) of each family."""
    packed = unpacked(made.head, "explorer-content")
    length = int.from_bytes(packed[:4], "little")
    content, codes = json.loads(packed[4 : 4 + length]), np.frombuffer(packed[4 + length :], np.uint8)
    values = []
    for family in content["families"]:
        grid = content["grids"][family["grid"]]
        shape = len(family["levels"]), 2, grid["rows"], grid["columns"]
        low, high = np.moveaxis(codes[family["offset"] :][: np.prod(shape)].reshape(shape).astype(np.uint16), 1, 0)
        code = np.cumsum(low + 256 * high, axis=-1, dtype=np.uint16)
        values.append(np.where(code > 0, family["low"] + (code - 1.0) * family["step"], np.nan))
    return SimpleNamespace(**content, values=values)


def window_of(study):
    """Rows and columns of the map."""
    return study.basemap.window(study.hazard["members_reached"].fillna(0).values > 0)


def test_every_map_of_the_product_is_there_and_differs_by_less_than_its_step(study, made):
    content, window = content_of(made), window_of(study)
    at = {family["name"]: k for k, family in enumerate(content.families) if family["grid"] == "products"}
    maps = {str(name) for name, array in study.hazard.data_vars.items() if array.dims[-2:] == ("y", "x")}
    assert set(at) == maps
    assert len({tuple(family) for family in content.families}) == 1, "one order of keys, so that equal results give equal bytes"
    assert list(content.families[0])[:3] == ["name", "group", "title"]
    for name, k in at.items():
        array, family = study.hazard[name], content.families[k]
        divisor = VARIABLES[name].printed[1]
        product = array.values.reshape(-1, *array.shape[-2:])[(slice(None), *window)] / divisor
        assert product.shape == content.values[k].shape, name
        assert np.array_equal(np.isnan(product), np.isnan(content.values[k])), name
        assert np.nan_to_num(np.abs(product - content.values[k])).max() <= family["step"] * 1.001, name
        assert np.array_equal(np.nan_to_num(product) > 0, np.nan_to_num(content.values[k]) > 1e-9), (
            name
        )  # what is reached stays reached


def test_steps_are_round_and_below_a_thousandth_of_the_largest_value(study):
    for family in families(study.hazard, Grid(window_of(study))):
        largest = float(np.nanmax(np.abs(family.values)))
        span = float(np.ptp(family.values)) if family.name == "elevation" else largest
        if family.name not in ("members_reached",) and span > 0:
            assert family.step <= max(span, 1.0) / 1000 * 1.001, family.name
    assert round_step(37.0, 1000) == 0.02
    assert round_step(0.0, 1000) == 1.0


def test_steps_are_small_beside_the_first_class(study):
    pressure = next(one for one in families(study.hazard, Grid(window_of(study))) if one.name == "peak_pressure")
    first = min(edge for edge in pressure.classes.edges if edge > 0)
    assert pressure.step <= 0.1 * first * 1.001
    assert step_of("members_reached", np.ones((2, 2)), pressure.classes) == 1.0


def test_members_have_their_own_values_by_number(study, made, results):
    content, window = content_of(made), window_of(study)
    for name in ("max_flow_thickness", "max_speed", "arrival_time", "deposit_thickness"):
        k = next(k for k, family in enumerate(content.families) if family["name"] == name)
        family = content.families[k]
        assert family["levels"] == ["0", "1", "2", "3", "4", "6", "7"]  # 5 failed
        for level, member in enumerate(family["levels"]):
            with xr.open_dataset(results / "members" / f"{int(member):04d}.nc", decode_timedelta=False) as file:
                own = file[name].values[window]
            assert np.nanmax(np.abs(own - content.values[k][level])) <= family["step"] * 1.001
    assert len(content.members) == 7
    assert "basal friction angle [°]: 12" in content.members[0]


def test_first_map_is_the_probability_of_the_threshold_of_the_first_screen(made, study):
    content = content_of(made)
    family, level = content.first
    assert content.families[family]["name"] == "thickness_exceedance_probability"
    assert content.families[family]["levels"][level].startswith(f"≥\N{NO-BREAK SPACE}{study.threshold:g}")


def test_cells_and_pictures_lie_where_the_raster_lies(study, made):
    content = content_of(made)
    rows, columns = window_of(study)
    grid = content.grids["products"]
    assert grid["west"] == study.basemap.easting[columns][0] - grid["dx"] / 2
    assert grid["north"] == study.basemap.northing[rows][0] + grid["dy"] / 2
    assert content.ground[0]["extent"] == list(study.basemap.extent(study.basemap.whole))
    assert content.ground[0]["image"].startswith("data:image/jpeg;base64,")


def test_legend_has_a_colour_and_words_for_each_class(made):
    families = content_of(made).families
    assert {"max_flow_thickness", "max_speed"} <= {family["name"] for family in families}
    for family in families:
        assert len(family["edges"]) == len(family["colours"]) == len(family["labels"]), family["name"]
        assert family["edges"] == sorted(family["edges"])
        assert all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in family["colours"])


def test_coarse_cells_hold_the_largest_value_and_the_earliest_arrival():
    values = np.arange(35.0).reshape(5, 7)
    values[0, 0] = np.nan
    grid = Grid((slice(0, 5), slice(0, 7)), 3)
    largest, earliest = grid.reduce(values), grid.reduce(values, np.fmin)
    assert largest.shape == earliest.shape == grid.shape == (2, 3)
    assert largest[0, 0] == values[:3, :3][np.isfinite(values[:3, :3])].max()
    assert earliest[0, 0] == 1.0
    assert largest[1, 2] == values[4, 6]
    assert earliest[1, 2] == values[3, 6]


def test_large_windows_get_coarser_cells_and_say_so(study, site, monkeypatch):
    from runout.report import explorer as module

    monkeypatch.setattr(module, "MOST_VALUES", 200_000)
    made = explorer(study, site.resolved())
    content = content_of(made)
    factor = round(content.grids["products"]["dx"] / study.basemap.cell_size[0])
    assert factor > 1
    assert f"of {factor} x {factor} cells of the raster" in made.body
    k = next(k for k, family in enumerate(content.families) if family["name"] == "peak_flow_thickness")
    peak = study.hazard["peak_flow_thickness"].values[window_of(study)].max()
    assert np.nanmax(content.values[k]) == pytest.approx(peak, abs=content.families[k]["step"])


def test_map_of_500_members_stays_small_and_states_its_cells(study, site, monkeypatch):
    random = np.random.default_rng(1)

    def stacked(stack, numbers, grid):  # fields as rough as those of a flow in a tenth of the cells
        rows, columns = grid.shape
        reached = (np.abs(np.arange(columns) / columns - 0.5) < 0.2)[None, :] & (np.arange(rows) / rows > 0.3)[:, None]
        field = random.gamma(2.0, 3.0, (len(numbers), rows, columns)).astype(np.float32)
        return {name: np.where(reached, field, 0.0) for name in explorer_module.SHOWN if name in stack.maps}

    members = study.members.loc[[0] * 500].reset_index(drop=True)
    monkeypatch.setattr(explorer_module, "stacked", stacked)
    made = explorer(replace(study, members=members), site.resolved())
    assert len(made.head) + len(made.body) < 4e6
    content = content_of(made)
    factor = round(content.grids["members"]["dx"] / study.basemap.cell_size[0])
    assert factor > 1
    assert (
        f"Each cell of the maps of members shows the largest value (of arrival: the earliest) of {factor} x {factor}" in made.body
    )
    assert next(family for family in content.families if family["choice"] == "Member")["levels"][-1] == "499"


def test_texts_of_users_do_not_leave_the_data(study, site):
    marked = replace(study, basemap=replace(study.basemap, probes=[Mark(study.basemap.outlines[0].centroid, EVIL)]))
    settings = site.resolved() | {"metadata": {"acknowledgement": EVIL}}
    made = explorer(marked, settings)
    assert "<img" not in made.head + made.body
    content = content_of(made)
    assert EVIL in content.attribution
    assert [item["label"] for group in content.marks if group["name"] == "Probes" for item in group["items"]] == [EVIL]


def test_page_asks_no_other_host(made):
    assert not re.search(r"(src|href)\s*=|\burl\(|@import|fetch\(|XMLHttpRequest", made.head + made.body)


@pytest.mark.parametrize("change", ["zero", "no crs", "one member", "no value"])
def test_odd_products_have_a_map(study, site, change):
    hazard = study.hazard.copy()
    if change == "no crs":
        hazard = hazard.drop_vars("crs")
    elif change in ("zero", "no value"):
        for name, array in hazard.data_vars.items():
            if array.dims[-2:] == ("y", "x") and name != "elevation":
                hazard[name] = array * (0.0 if change == "zero" else np.nan)
    members = study.members.iloc[:1] if change == "one member" else study.members
    content = content_of(explorer(replace(study, hazard=hazard, members=members), site.resolved()))
    assert content.axes == (["x", "y"] if change == "no crs" else ["Easting", "Northing"])
    if change == "one member":
        assert {len(family["levels"]) for family in content.families if family["choice"] == "Member"} == {1}


def test_snapshots_of_a_member_are_maps_at_times(study, site, tmp_path, results):
    import shutil

    from runout.hazard.reach import representative

    own = tmp_path / "results"
    shutil.copytree(results, own)
    member = representative(study.valid)
    thickness = xr.DataArray(np.zeros((2, *study.basemap.elevation.shape)), dims=("time", "y", "x"))
    rows, columns = window_of(study)
    thickness[1, rows.start + 3, columns.start + 5] = 4.0
    places = {"time": [0.0, 12.5], "x": study.basemap.easting, "y": study.basemap.northing}
    snapshots = xr.Dataset({"flow_thickness": thickness, "speed": 2 * thickness}, coords=places)
    snapshots.to_netcdf(own / "members" / f"{member:04d}.nc", mode="a", group="snapshots")
    content = content_of(explorer(read_study(own), site.resolved()))
    k = next(k for k, family in enumerate(content.families) if family["choice"] == "Snapshot")
    assert content.families[k]["levels"] == ["0 s", "12.5 s"]
    assert content.values[k][1, 3, 5] == pytest.approx(4.0, abs=content.families[k]["step"])
    assert np.nansum(content.values[k]) == pytest.approx(4.0, abs=content.families[k]["step"])


def orthophoto(path, study, shift=0.0):
    """Red picture of the western half of the raster, blue of the other."""
    west, east, south, north = study.basemap.extent(study.basemap.whole)
    bands = np.zeros((3, 40, 60), np.uint8)
    bands[0, :, :30] = bands[2, :, 30:] = 255
    transform = rasterio.transform.from_bounds(west + shift, south, east + shift, north, 60, 40)
    layout = {"driver": "GTiff", "count": 3, "height": 40, "width": 60, "dtype": "uint8", "crs": "EPSG:32616"}
    with rasterio.open(path, "w", **layout, transform=transform) as file:
        file.write(bands)


def test_orthophoto_lies_on_the_window_of_the_map(study, site, tmp_path):
    import io

    from PIL import Image

    orthophoto(tmp_path / "photo.tif", study)
    settings = site.resolved() | {"report": {"orthophoto": "photo.tif"}}
    picture = content_of(explorer(study, settings, tmp_path)).orthophoto
    assert picture["extent"] == list(study.basemap.extent(window_of(study)))
    shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture["image"].partition(",")[2]))))
    west, east = picture["extent"][:2]
    middle = float(np.mean(study.basemap.extent(study.basemap.whole)[:2]))
    edge = round((middle - west) / (east - west) * shown.shape[1])
    assert (shown[:, : edge - 30, 0] > 200).all()
    assert (shown[:, edge + 30 :, 2] > 200).all()


def test_orthophoto_elsewhere_is_refused(study, site, tmp_path):
    orthophoto(tmp_path / "photo.tif", study, shift=1e5)
    settings = site.resolved() | {"report": {"orthophoto": "photo.tif"}}
    with pytest.raises(InputError, match="does not touch the window"):
        explorer(study, settings, tmp_path)


def written(made, path):
    """Path of a page with the explorer alone."""
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    path.write_text(
        f"<!doctype html><html lang='en'><head>{head}</head><body>{made.body}{made.head}</body></html>", encoding="utf-8"
    )
    return path


def pixel_of(page, x, y):
    """Place of map coordinates [m] on the screen."""
    return page.run(
        "(() => { const plot = Bokeh.documents.map((d) => d.roots()[0]).find((r) => r.renderers.length > 2);"
        "const {x_scale, y_scale} = Bokeh.index.get_by_id(plot.id).frame;"
        "const map = document.getElementById('explorer-map').getBoundingClientRect();"
        f"return {{x: map.x + x_scale.compute({x}), y: map.y + y_scale.compute({y})}}; }})()"
    )


@pytest.mark.usefixtures("browser")
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, True)])
def test_browser_shows_the_value_of_each_map_without_a_request(study, made, tmp_path, width, dark):
    with Page(tmp_path, width, dark=dark) as page:
        page.open(written(made, tmp_path / "map.html"), READY)
        assert page.run("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        peaks = study.hazard["peak_flow_thickness"]
        row, column = np.unravel_index(int(peaks.values.argmax()), peaks.shape)
        wanted = float(peaks["x"][column]), float(peaks["y"][row])
        page.call("Input.dispatchMouseEvent", type="mouseMoved", **pixel_of(page, *wanted))
        place = page.run("document.getElementById('explorer-place').textContent")
        x, y = map(float, re.fullmatch(r"Easting (\d+) m, northing (\d+) m", place).groups())
        assert (x, y) == pytest.approx(wanted, abs=10.0)
        at = study.hazard.isel(x=column, y=row)
        shown = page.run(
            "Object.fromEntries([...document.querySelectorAll('#explorer-readout tr')]"
            ".map((row) => [...row.children].map((cell) => cell.textContent)))"
        )
        peak = float(at["peak_flow_thickness"])
        assert peak > 1.0
        assert float(shown["Flow thickness, largest of all members"].split("\u202f")[0]) == pytest.approx(peak, abs=0.02)
        speeds = re.findall(r"%: ([\d.]+)", shown["Flow speed, percentile of the members"])
        assert [float(speed) for speed in speeds] == pytest.approx(at["speed_percentile"].values.tolist(), abs=0.05)
        assert page.errors == page.requests == []


@pytest.mark.usefixtures("browser")
def test_browser_reads_each_map_and_opens_each_list_by_its_controls(made, tmp_path):
    with Page(tmp_path) as page:
        page.open(written(made, tmp_path / "map.html"), READY)
        families = content_of(made).families
        headings = page.run(
            "(async () => { const list = document.getElementById('explorer-family'), texts = [];"
            "for (let k = 0; k < list.options.length; k++) { list.value = k; list.dispatchEvent(new Event('change'));"
            "texts.push(document.querySelector('#explorer-legend b').textContent); } return texts; })()"
        )
        assert len(headings) == len(families)
        assert headings[-1].startswith("Member 0: ")
        page.run(
            "(() => { const s = document.getElementById('explorer-slider'); s.value = 2; s.dispatchEvent(new Event('input')); })()"
        )
        assert page.run("document.querySelector('#explorer-legend b').textContent").startswith("Member 2: ")
        controls = "[...document.querySelectorAll('.explorer select, .explorer input')]"
        unnamed = f"{controls}.filter((one) => !one.labels.length && !one.ariaLabel).length"
        assert page.run(unnamed) == 0
        assert page.errors == []


def details_of(content, group, label):
    """What opens with a mark."""
    items = next(one["items"] for one in content.marks if one["name"] == group)
    return next(item["details"] for item in items if item["label"] == label)


def probe_series(study):
    """Percentiles of the discharge and others at a section."""
    time = np.linspace(0.0, 90.0, 1300)
    wave = np.maximum(0.0, 40.0 - np.abs(time - 30.0))
    values = np.stack([0.5 * wave, wave, 2.0 * wave])[:, None, :]
    names = ("discharge", "passed_volume", "largest_thickness", "flow_width")
    series = dict.fromkeys(names, (("percentile", "station", "time"), values))
    coords = {"percentile": [5.0, 50.0, 95.0], "time": time, "station_name": ("station", ["road"])}
    return xr.Dataset(series, coords=coords)


def test_section_opens_its_series_with_median_and_band(study, site):
    from shapely import LineString

    west, _, south, _ = study.basemap.extent(study.basemap.whole)
    marks = [Mark(LineString([(west + 100, south + 100), (west + 500, south + 100)]), "road")]
    probed = replace(study, basemap=replace(study.basemap, probes=marks), probes={"cross_sections": probe_series(study)})
    details = details_of(content_of(explorer(probed, site.resolved())), "Probes", "road")
    chart = details["charts"][0]
    assert (chart["title"], chart["unit"]) == ("discharge", "m³ s⁻¹")
    assert max(chart["lines"][0]["y"]) == pytest.approx(40.0, rel=0.01)
    assert max(chart["band"]["high"]) == pytest.approx(80.0, rel=0.01)
    assert len(chart["x"]) == len(chart["band"]["low"]) <= 650
    assert details["remark"].endswith("One in 3 values is drawn.")


def test_structure_opens_the_loads_of_its_facades(study, site, monkeypatch):
    from runout.report import explorer_marks

    house = study.basemap.outlines[0].buffer(10.0)
    loads = SimpleNamespace(over=xr.Dataset({"structure_name": ("facade", ["house", "house", "barn"])}))
    section = {
        "headings": [("Structure", ""), ("Facade", ""), ("Force, largest", "kN")],
        "rows": [["house", "north", "12"], ["house", "east", "3"]], "rounding": "Loads are rounded.",
    }  # fmt: skip
    monkeypatch.setattr(explorer_marks, "structure_section", lambda *_: section)
    built = replace(study, loads=loads, basemap=replace(study.basemap, obstacles=[Mark(house, "house"), Mark(house, "barn")]))
    content = content_of(explorer(built, site.resolved()))
    tables = details_of(content, "Obstacles and structures", "house")["tables"]
    assert tables == [[["Facade", "north"], ["Force, largest [kN]", "12"]], [["Facade", "east"], ["Force, largest [kN]", "3"]]]
    assert details_of(content, "Obstacles and structures", "barn") == {"tables": [], "remark": "No member reaches it."}


def test_profile_opens_its_section(study, site, tmp_path, results):
    import shutil

    own = tmp_path / "results"
    shutil.copytree(results, own)
    (own / "profiles").mkdir()
    west, _, south, _ = study.basemap.extent(study.basemap.whole)
    distance = np.linspace(0.0, 400.0, 81)
    names = ("max_flow_thickness", "max_speed", "arrival_time", "deposit_thickness")
    profile = xr.Dataset(
        dict.fromkeys(names, ("distance", distance / 100.0)), coords={"distance": distance}, attrs={"line": "axis"}
    )
    profile["x"], profile["y"] = ("distance", west + 100 + distance), ("distance", np.full(81, south + 200.0))
    profile["bed_elevation"] = profile["ground_elevation"] = ("distance", 500.0 - 0.2 * distance)
    profile.to_netcdf(own / "profiles" / "axis_ensemble_axis.nc")
    details = details_of(content_of(explorer(read_study(own), site.resolved())), "Profiles", "axis (axis_ensemble_axis)")
    assert [chart["title"] for chart in details["charts"]] == ["elevation", "thickness", "speed", "arrival", "deposit"]
    assert details["charts"][0]["lines"][0]["y"][-1] == pytest.approx(420.0)
    assert details["charts"][1]["lines"][0]["y"][-1] == pytest.approx(4.0)


@pytest.mark.usefixtures("browser")
def test_pointer_on_a_mark_shows_its_label_as_text_and_a_click_opens_it(study, site, tmp_path):
    from shapely import Point

    west, east, south, north = study.basemap.extent(window_of(study))
    middle = 0.5 * (west + east), 0.5 * (south + north)
    series = probe_series(study).rename(largest_thickness="flow_thickness", flow_width="speed", passed_volume="pressure")
    probes = {"probe_points": series.assign_coords(station_name=("station", [EVIL]))}
    marked = replace(study, basemap=replace(study.basemap, probes=[Mark(Point(middle), EVIL)]), probes=probes)
    with Page(tmp_path) as page:
        page.open(written(explorer(marked, site.resolved()), tmp_path / "map.html"), READY)
        place = pixel_of(page, *middle)
        for move in (3, 1, 0):
            page.call("Input.dispatchMouseEvent", type="mouseMoved", x=place["x"] + move, y=place["y"])
        for kind in ("mousePressed", "mouseReleased"):
            page.call("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, **place)
        page.run("new Promise((resolve) => setTimeout(resolve, 500))")
        assert page.run("document.querySelector('#explorer-details b').textContent") == EVIL
        assert page.run("document.querySelectorAll('#explorer-details > div').length") == 3
        everywhere = (
            "const all = (root) => [...root.querySelectorAll('*')].flatMap((e) => [e, ...(e.shadowRoot ? all(e.shadowRoot) : [])]);"
        )
        assert page.run(f"(() => {{ {everywhere} return all(document).filter((e) => e.tagName === 'IMG').length; }})()") == 0
        tooltip = f"(() => {{ {everywhere} return all(document).filter((e) => e.className.includes?.('bk-Tooltip')).length; }})()"
        assert page.run(tooltip) == 1
        assert page.errors == page.requests == []

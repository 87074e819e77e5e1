"""Messages on keys in the wrong place, and on input files: each names line and key of site.yaml."""

import json
from pathlib import Path

import numpy as np
import pytest
from refused_site import problems

from runout.config.stated_at import within_site
from runout.workflow.check import inspect

OBSERVED = "ensemble:\n  members: 4"


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("outline: {file: a.gpkg}", "outline.file: unknown key; choose among polygons, layer, shows"),
        ("file: a.gpkg", "file: unknown key; choose among outline, deposit, difference, gauges, thalweg"),
        ("polygons: a.gpkg", "polygons: unknown key; it belongs under 'observations.outline'"),
        ("raster: a.tif", "raster: unknown key; it belongs under 'observations.deposit' or 'observations.difference'"),
        ("points: a.gpkg", "points: unknown key; it belongs under 'observations.gauges'"),
    ],
)
def test_unknown_key_of_observations_is_not_sent_to_structures(edited, stated, said):
    folder = edited(OBSERVED, f"observations:\n  {stated}\n{OBSERVED}")
    assert any(line.endswith(f"observations.{said}") for line in problems(folder))


def test_unknown_key_of_the_terrain_is_sent_to_the_blocks_in_it(edited):
    (said,) = problems(edited("terrain:\n", "terrain:\n  polygons: inputs/release.geojson\n"))
    assert said.endswith("polygons: unknown key; it belongs under 'terrain.obstacles' or 'terrain.friction_zones'")


@pytest.mark.parametrize("stated", ["xi", "basal_friction_xi"])
def test_sampled_parameter_without_its_prefix_is_named_with_it(edited, stated):
    edited("basal_friction_angle_deg: 20", "basal_friction: {law: voellmy, mu: 0.2, xi: 1000}")
    folder = edited("    basal_friction_angle_deg: {", f"    {stated}: {{")
    assert [line.split("; ")[-1] for line in problems(folder)] == ["did you mean 'basal_xi'?"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("  - name: scar\n", "  - 5\n  - name: scar\n", "release[0]: 5 is a number; a block of `key: value` lines is needed"),
        ("  cell_size: 10", "  cell_size:", "simulation: neither cell_size nor accuracy is given; add cell_size: [m], or"),
    ],
)
def test_one_cause_gives_one_message_with_its_line(edited, old, new, said):
    found = problems(edited(old, new))
    assert len(found) == 1
    assert found[0].startswith("site.yaml:")
    assert said in found[0]


def test_empty_friction_of_a_zone_gives_one_message(edited):
    edited("basal_friction_angle_deg: 20", "basal_friction: {law: voellmy, mu: 0.2, xi: 1000}")
    edited("    basal_friction_angle_deg: {", "    basal_xi: {")
    zones = "  friction_zones:\n    - polygons: inputs/release.geojson\n      basal_friction:\n        mu:\n"
    folder = edited("release:\n  - name", f"{zones}release:\n  - name")
    place = "site.yaml:9: terrain.friction_zones[0].basal_friction.mu"
    assert problems(folder) == [f"{place}: has no value; a number is needed; write it, or remove the key"]


def test_faults_of_input_files_name_line_and_key_of_site_yaml_all_at_once(edited):
    edited(OBSERVED, f"observations:\n  gauges: {{points: inputs/release.geojson, speed: depth}}\n{OBSERVED}")
    edited("thickness: 4.0", "thickness: 4 m")
    folder = edited("  - name: scar\n", "  - {name: first, polygons: inputs/release.geojson, volume: -1}\n  - name: scar\n")
    said = inspect(folder).problems
    assert len(said) == 3
    assert said[0].startswith("site.yaml:7: release[0].volume: ")
    assert said[1].startswith("site.yaml:9: release[1].polygons: ")
    assert "for a number write 4, without a unit" in said[1]
    assert said[2].startswith("site.yaml:20: observations.gauges: ")
    assert "single points" in said[2]


def test_faults_of_elevations_zones_and_obstacles_name_their_lines(edited, site_folder):
    inputs = site_folder / "inputs"
    away = json.loads((inputs / "release.geojson").read_text(encoding="utf-8"))
    geometry = away["features"][0]["geometry"]
    geometry["coordinates"] = (np.asarray(geometry["coordinates"]) + 1e5).tolist()
    (inputs / "away.geojson").write_text(json.dumps(away), encoding="utf-8")
    entries = "".join(f"    - {{polygons: inputs/{name}.geojson, factor: 2}}\n" for name in ("release", "away"))
    folder = edited("  crs: EPSG:32632\n", f"  crs: EPSG:32632\n  friction_zones:\n{entries}")
    assert any(line.startswith("site.yaml:8: terrain.friction_zones[1]: ") for line in inspect(folder).problems)
    edited("friction_zones:", "obstacles:")
    folder = edited("factor: 2", "height: 2")
    assert any(line.startswith("site.yaml:8: terrain.obstacles[1]: ") for line in inspect(folder).problems)
    (inputs / "dem.asc").write_text("no raster", encoding="utf-8")
    said = inspect(folder).problems
    assert len(said) == 1
    assert said[0].startswith("site.yaml:4: terrain.dem: ")


@pytest.mark.parametrize(
    ("folder", "text", "expected"),
    [
        ("s", "s/inputs/dem.tif: no cell", "inputs/dem.tif: no cell"),
        ("s", "inputs/dem.tif and inputs/s/a.tif stay", "inputs/dem.tif and inputs/s/a.tif stay"),
        ("puts", "inputs/dem.tif, puts/inputs/dem.tif", "inputs/dem.tif, inputs/dem.tif"),
        ("s", "../s/a.tif, ~s/a.tif, my-s/a.tif, HERE/others/s/a.tif", "../s/a.tif, ~s/a.tif, my-s/a.tif, HERE/others/s/a.tif"),
        ("s", "HERE/s/inputs/dem.vrt: its source `s/x.tif`", "inputs/dem.vrt: its source `x.tif`"),
        ("süd (1)", "süd (1)/inputs/dem.tif", "inputs/dem.tif"),
        ("m2", "m2/a.tif, m2/s/dem, m2/s: 3 m2/s and 2 m2/s.", "a.tif, s/dem, m2/s: 3 m2/s and 2 m2/s."),
        ("kg", "kg/dem.tif of 2000 kg/m3", "dem.tif of 2000 kg/m3"),
        ("..", "../../a.tif: lies outside", "../../a.tif: lies outside"),
        (".", "inputs/./a.tif, HERE/inputs/dem.tif", "inputs/./a.tif, inputs/dem.tif"),
    ],
)
def test_a_message_loses_the_folder_of_the_site_and_no_part_of_another_path(folder, text, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    here = str(tmp_path)
    assert within_site(text.replace("HERE", here), Path(folder)) == expected.replace("HERE", here)

"""From settings to the arguments of a member: samples, friction, snapshots, what the command line states instead, probes."""

import math
import pickle
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely

from runout import Coulomb, VelocityWeakening
from runout.config.member_arguments import even_times
from runout.config.probes import probe_settings
from runout.config.site import read_site
from runout.errors import ConfigError, DeviceError, ReleaseError, StructureError
from runout.release.statements import record, start_sentences

WEST, SOUTH = 500_000.0, 5_000_000.0
WEAK = "basal_friction: {law: velocity_weakening, static_friction: 0.5, dynamic_friction: 0.1, weakening_speed: 5}\n"


SAMPLED = "basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}"
VOLUMES = "release_volume_factor: {distribution: uniform, low: 0.5, high: 2}"


def write_layer(path, *geometries, **attributes):
    gpd.GeoDataFrame(attributes, geometry=list(geometries), crs="EPSG:32632").to_file(path)


def test_arguments_of_a_member_are_the_settings_with_the_sampled_values(site_folder):
    site = read_site(site_folder)
    arguments = site.member_arguments({"basal_friction_angle_deg": 15.0, "release_volume_factor": 0.5, "seed": 7, "weight": 0.25})
    assert arguments["basal_friction_angle"] == 15.0
    assert arguments["seed"] == 7
    (release,) = arguments["release"]
    assert release.volume == pytest.approx(0.5 * 1600 * 4.0)
    assert (arguments["cell_size"], arguments["end_time"], arguments["stop"]) == (10.0, 30.0, True)
    assert (arguments["backend"], arguments["device"], arguments["arrival_threshold"]) == ("scan", "cpu", 0.1)
    assert arguments["particles_per_cell"] == (2, 2, 20), "0.2 cells through the mass: twenty levels"
    assert {"structures", "probes", "snapshot_times"}.isdisjoint(arguments)
    plain = site.member_arguments()
    assert (plain["basal_friction_angle"], plain["seed"], plain["release"][0].volume) == (20.0, 0, pytest.approx(6400.0))
    with pytest.raises(ConfigError, match=r"basal_mu: not a parameter of a member; choose among .*basal_friction_angle_deg"):
        site.member_arguments({"basal_mu": 0.2})


def test_lists_of_settings_are_tuples_and_snapshots_are_times(edited):
    site = read_site(edited("cell_size: 10", "cell_size: [10, 5, 4]\n  particles_per_cell: [3, 2, 4]\n  snapshots: 4"))
    arguments = site.member_arguments()
    assert (arguments["cell_size"], arguments["particles_per_cell"]) == ((10.0, 5.0, 4.0), (3, 2, 4))
    assert arguments["snapshot_times"] == (0.0, 10.0, 20.0, 30.0)
    assert even_times(30.0, 1) == (0.0,)


def test_a_sampled_parameter_replaces_the_stated_one_and_that_of_a_release_both(edited):
    edited("basal_friction_angle_deg: 20\n", WEAK)
    edited("    basal_friction_angle_deg: {dist", "    basal_static_friction: {dist")
    edited("low: 12, high: 22", "low: 0.3, high: 0.8")
    site = read_site(edited("    thickness: 4.0\n", "    thickness: 4.0\n    basal_friction: {dynamic_friction: 0.2}\n"))
    arguments = site.member_arguments({"basal_static_friction": 0.7})
    assert arguments["basal_friction"] == VelocityWeakening(static_friction=0.7, dynamic_friction=0.1, weakening_speed=5.0)
    (release,) = arguments["release"]
    assert release.basal_friction == VelocityWeakening(static_friction=0.7, dynamic_friction=0.2, weakening_speed=5.0)
    (under,) = site.friction.of_releases(site.releases(), {"basal_static_friction": 0.6})
    assert under == VelocityWeakening(static_friction=0.6, dynamic_friction=0.2, weakening_speed=5.0)
    assert site.friction.law.name == "velocity_weakening"


def test_an_angle_of_a_release_counts_under_it_and_that_of_the_run_elsewhere(edited, site_folder):
    assert read_site(site_folder).friction.of_run({}) == pytest.approx(math.radians(20.0))
    (angle,) = read_site(site_folder).friction.of_releases(read_site(site_folder).releases(), {"basal_friction_angle_deg": 14.0})
    assert angle == pytest.approx(math.radians(14.0))
    edited(SAMPLED, VOLUMES)
    site = read_site(edited("    thickness: 4.0\n", "    thickness: 4.0\n    basal_friction: {friction_angle_deg: 17}\n"))
    (release,) = site.member_arguments()["release"]
    assert release.basal_friction == Coulomb(friction_angle=17.0)


@pytest.mark.parametrize(
    ("block", "said"),
    [
        ("0.2", "0.2 is a number; a block is needed"),
        ("{}", "states no parameter; add one of its law, or remove it"),
        ("{friction_angle_deg: }", "friction_angle_deg: has no value; a number is needed"),
        ("{friction_angle_deg: 70}", "friction_angle_deg: 70 deg is out of range"),
        ("{static_friction: 0.2}", "static_friction"),
    ],
)
def test_own_friction_of_a_release_that_means_nothing_is_refused(edited, block, said):
    edited(SAMPLED, VOLUMES)
    folder = edited("    thickness: 4.0\n", f"    thickness: 4.0\n    basal_friction: {block}\n")
    with pytest.raises(ConfigError) as refused:
        read_site(folder)
    (line,) = str(refused.value).splitlines()
    assert line.startswith("site.yaml:10: release[0].basal_friction")
    assert said in line


def test_the_command_line_may_state_another_device(site_folder, monkeypatch):
    simulation = read_site(site_folder).settings.simulation
    gpu = simulation.model_copy(update={"device": "cuda:0", "backend": "hash"})
    assert (gpu.on_device("cpu").device, gpu.on_device("cpu").backend) == ("cpu", "scan")
    reference = simulation.model_copy(update={"backend": "reference"})
    assert reference.on_device("cpu").backend == "reference"
    devices = {"cuda": "cuda:0", "auto": "cuda:0", "cuda:1": "cuda:1"}
    monkeypatch.setattr("runout.backends.protocol.find_device", devices.__getitem__)
    for device, place in (("cuda", "cuda"), ("auto", "cuda"), ("cuda:1", "cuda:1")):
        assert (simulation.on_device(device).device, simulation.on_device(device).backend) == (place, "hash")
    monkeypatch.setattr("runout.backends.protocol.find_device", lambda device: "cpu")
    assert (simulation.on_device("auto").device, simulation.on_device("auto").backend) == ("cpu", "scan")
    monkeypatch.undo()
    with pytest.raises(DeviceError):
        read_site(site_folder).on_device("cuda:77")
    assert read_site(site_folder).on_device("cpu").settings.simulation.device == "cpu"


def test_the_command_line_may_state_another_cell_size(site_folder):
    site = read_site(site_folder)
    assert site.settings.simulation.with_cell_size([4.0]).cell_size == 4.0
    assert site.settings.simulation.with_cell_size((4.0, 5.0, 3.0)).cell_size == [4.0, 5.0, 3.0]
    with pytest.raises(ConfigError, match="cell_size"):
        site.settings.simulation.with_cell_size([-4.0])


def test_settings_of_probes_from_the_command_line_name_files_relative_to_the_site(tmp_path):
    inside, outside = tmp_path / "site" / "inputs" / "points.gpkg", tmp_path / "sections.gpkg"
    inside.parent.mkdir(parents=True)
    for path in (inside, outside):
        path.write_bytes(b"")
    settings = probe_settings(tmp_path / "site", inside, outside, points_layer="a", cross_sections_layer="b", interval=0.5)
    assert (settings.points, settings.cross_sections) == ("inputs/points.gpkg", str(outside))
    assert (settings.points_layer, settings.cross_sections_layer, settings.interval) == ("a", "b", 0.5)
    assert probe_settings(tmp_path / "site", None, outside).points is None
    with pytest.raises(ConfigError) as refused:
        probe_settings(tmp_path, tmp_path / "sectionz.gpkg", None, cross_sections_layer="b", interval=0.0)
    lines = str(refused.value).splitlines()
    assert [line.split(": ", 1)[1] for line in lines[1:]] == [
        "--cross-sections-layer: 'b' without a file; name the file with --cross-sections, or leave the layer out",
        "--interval: 0 s; it must be above 0; leave it out for the default",
    ]
    assert lines[0].endswith(f"there is no such file; did you mean {outside}?")


def test_structures_of_a_site_reach_its_members_and_all_their_problems_come_at_once(edited, site_folder):
    inputs = site_folder / "inputs"
    write_layer(inputs / "house.gpkg", shapely.box(WEST + 200, SOUTH + 100, WEST + 230, SOUTH + 130))
    write_layer(inputs / "thin.gpkg", shapely.box(WEST + 200, SOUTH + 40, WEST + 260, SOUTH + 43))
    write_layer(inputs / "far.gpkg", shapely.box(WEST + 900, SOUTH, WEST + 910, SOUTH + 10))
    site = read_site(edited("ensemble:\n", "structures:\n  - {file: inputs/house.gpkg, height: 20, name: house}\nensemble:\n"))
    assert site.member_arguments()["structures"].names == ("house",)
    bad = "structures:\n  - {file: inputs/thin.gpkg, height: 20, protects: inputs/far.gpkg}\nensemble:\n"
    site = read_site(edited("structures:\n  - {file: inputs/house.gpkg, height: 20, name: house}\nensemble:\n", bad))
    with pytest.raises(StructureError) as refused:
        site.member_arguments()
    message = str(refused.value)
    assert "a wall is 3 m thick, less than two cells of 10 m" in message
    assert "lies beyond the terrain" in message


def test_a_site_reads_its_files_once_and_again_where_settings_differ(site_folder):
    site = read_site(site_folder)
    assert site.terrain() is site.terrain()
    assert site.on_device("cpu").terrain() is site.terrain()
    finer = site.with_settings(terrain=site.settings.terrain.model_copy(update={"resolution": 20.0}))
    assert finer.terrain().cell_size == (20.0, 20.0)
    copy = pickle.loads(pickle.dumps(site))
    np.testing.assert_array_equal(copy.terrain().elevation, site.terrain().elevation)
    assert site.files.recorded_in(Path(site_folder) / "record.json").terrain() is site.terrain()


def test_what_is_said_of_releases_has_their_numbers(edited, site_folder):
    (release,) = read_site(site_folder).releases()
    entries = record(release)
    assert (entries["name"], entries["volume"], entries["area"]) == ("scar", pytest.approx(6400.0), pytest.approx(1600.0))
    assert entries["mean_thickness"] == pytest.approx(4.0)
    assert entries["largest_thickness"] == pytest.approx(release.thickness.max())
    assert list(start_sentences([release])) == []
    both = list(start_sentences([release, release]))
    assert both[0].startswith("the 2 releases (scar, scar) start together at time zero, in every member; where each may fail alone")


def test_a_volume_factor_that_makes_the_release_too_thick_is_named(site_folder):
    with pytest.raises(ReleaseError, match=r"with 1e\+06 times the volume \(release_volume_factor\): .*thickness is"):
        read_site(site_folder).releases(sample={"release_volume_factor": 1e6})

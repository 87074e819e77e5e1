"""What a site makes of its settings: terrain, releases, arguments of a simulation, inputs, plain configuration."""

import inspect
import json
from pathlib import Path

import numpy as np
import pytest

from runout import Terrain, read_site, simulate
from runout.errors import ConfigError, MaterialError


def test_site_is_read_from_its_folder_or_its_file_alike(site_folder):
    assert read_site(site_folder).settings == read_site(site_folder / "site.yaml").settings
    assert read_site(site_folder).folder == site_folder
    assert read_site(str(site_folder)).name == "slope"


def test_release_has_the_stated_volume_and_reference_system(site_folder):
    site = read_site(site_folder)
    terrain = site.terrain()
    (release,) = site.releases(terrain)
    assert "32632" in terrain.crs
    assert release.volume == pytest.approx(40 * 40 * 4.0, rel=1e-12)
    assert release.name == "scar"


def test_volume_factor_scales_the_volume_and_keeps_the_outline(site_folder):
    site = read_site(site_folder)
    terrain = site.terrain()
    (stated,), (doubled,) = site.releases(terrain), site.releases(terrain, {"release_volume_factor": 2.5})
    assert doubled.volume == pytest.approx(2.5 * stated.volume, rel=1e-14)
    assert (doubled.thickness >= stated.thickness).all()
    assert doubled.area == stated.area
    assert doubled.placement == stated.placement


def test_thickness_from_an_attribute_and_an_own_angle_reach_the_release(edited):
    edited("    basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}", "    {}")
    site = read_site(edited("thickness: 4.0", "thickness: depth\n    basal_friction_angle_deg: 15\n    placement: on_surface"))
    (release,) = site.releases(site.terrain())
    assert release.volume == pytest.approx(6400.0)
    assert release.basal_friction_angle == pytest.approx(np.radians(15.0))
    assert release.placement == "on_surface"


def test_arguments_of_a_member_carry_the_sampled_values_in_their_place(site_folder):
    sample = {
        "basal_friction_angle_deg": 13.5,
        "density": 1800.0,
        "youngs_modulus": 2e6,
        "friction_angle_deg": 33.0,
        "cohesion": 500.0,
    }
    arguments = read_site(site_folder).member_arguments(sample)
    assert arguments["basal_friction_angle"] == 13.5
    material = arguments["material"]
    assert (material.density, material.youngs_modulus) == (1800.0, 2e6)
    assert (material.friction_angle, material.cohesion) == (33.0, 500.0)
    assert material.poisson_ratio == 0.3


def test_arguments_without_a_sample_are_the_stated_ones(site_folder):
    arguments = read_site(site_folder).member_arguments({})
    assert arguments["basal_friction_angle"] == 20.0
    assert arguments["material"].friction_angle == 30.0
    assert (arguments["cell_size"], arguments["end_time"], arguments["stop"]) == (10.0, 30.0, True)


def test_substeps_of_the_site_reach_the_simulation(edited):
    site = read_site(edited("end_time: 30", "end_time: 30\n  substeps: 3"))
    assert site.member_arguments({})["substeps"] == 3
    assert site.computed() != read_site(edited("substeps: 3", "substeps: 2")).computed()


def test_arguments_of_a_member_are_arguments_of_simulate(site_folder):
    bound = inspect.signature(simulate).bind(**read_site(site_folder).member_arguments())
    assert {"terrain", "release", "material", "end_time"} <= set(bound.arguments)


def test_row_of_the_table_of_members_is_accepted_whole(site_folder):
    row = {"basal_friction_angle_deg": 14.0, "weight": 0.25, "seed": 77}
    assert read_site(site_folder).member_arguments(row)["seed"] == 77


def test_sample_of_an_unknown_parameter_is_refused(site_folder):
    with pytest.raises(ConfigError, match="basal_friction: not a parameter of a member; choose among basal_friction_angle_deg"):
        read_site(site_folder).member_arguments({"basal_friction": 14.0})


def test_sampled_value_out_of_range_is_refused_by_the_material(site_folder):
    with pytest.raises(MaterialError, match="density"):
        read_site(site_folder).material({"density": -5.0})


def test_cell_size_per_axis_arrives_as_a_tuple(edited):
    assert read_site(edited("cell_size: 10", "cell_size: [10, 10, 5]")).member_arguments()["cell_size"] == (10.0, 10.0, 5.0)


def test_inputs_are_the_files_that_site_yaml_names(site_folder):
    assert read_site(site_folder).inputs() == [site_folder / "inputs/dem.asc", site_folder / "inputs/release.geojson"]


def test_inputs_of_a_shapefile_are_all_its_parts(edited, site_folder):
    import geopandas

    geopandas.read_file(site_folder / "inputs/release.geojson").to_file(site_folder / "inputs/outline.shp")
    site = read_site(edited("inputs/release.geojson", "inputs/outline.shp"))
    assert {p.suffix for p in site.inputs()[1:]} == {".shp", ".shx", ".dbf", ".prj", ".cpg"}


def test_input_of_the_sample_raster_is_the_file_in_matplotlib(edited):
    (sample, _) = read_site(edited("inputs/dem.asc\n  crs: EPSG:32632", "matplotlib:jacksboro_fault_dem")).inputs()
    assert sample.name == "jacksboro_fault_dem.npz"
    assert sample.is_file()


def test_resolved_configuration_is_plain_and_complete_and_free_of_machine_paths(site_folder):
    resolved = read_site(site_folder).resolved()
    text = json.dumps(resolved)
    assert json.loads(text) == resolved
    assert resolved["simulation"]["cfl"] == 0.6
    assert resolved["basal_friction_angle_deg"] == 20.0
    assert str(Path(site_folder).parent) not in text


def test_coarser_terrain_is_the_mean_of_whole_blocks_and_says_so(edited):
    site = read_site(edited("  crs:", "  resolution: 20\n  crs:"))
    fine = read_site(site.folder).terrain()
    assert fine.cell_size == (20.0, 20.0)
    assert fine.shape == (10, 15)
    assert fine.elevation[0, 0] == pytest.approx(100 - 1.5 + 0.005)  # rows 0 and 1, columns 0 and 1
    assert fine.elevation[-1, -1] == pytest.approx(100 - 3 * 28.5 + 0.01 * 18.5)
    assert (fine.west, fine.south) == (500000.0, 5000000.0)
    assert "2 x 2 cells" in fine.changes[-1]


def test_blocks_of_a_coarser_terrain_start_at_the_south_west_corner(edited):
    terrain = read_site(edited("inputs/dem.asc", "inputs/dem.asc\n  resolution: 60")).terrain()
    assert terrain.shape == (3, 5)  # of 20 x 30 cells the northern 2 rows are left
    assert terrain.elevation[-1, 0] == pytest.approx(100 - 3 * 2.5 + 0.01 * 16.5)
    terrain = read_site(edited("resolution: 60", "resolution: 40")).terrain()
    assert terrain.shape == (5, 7)  # the eastern 2 columns are left
    assert terrain.elevation[0, -1] == pytest.approx(100 - 3 * 25.5 + 0.01 * 1.5)
    assert (terrain.west, terrain.south) == (500000.0, 5000000.0)


def test_release_volume_is_the_same_on_a_coarser_terrain(edited):
    site = read_site(edited("  crs:", "  resolution: 50\n  crs:"))
    assert site.releases(site.terrain())[0].volume == pytest.approx(6400.0)


def test_resolution_finer_than_the_raster_is_refused(edited):
    with pytest.raises(ConfigError, match=r"terrain\.resolution: 2 m is finer than the raster's own cells of 10 m x 10 m"):
        read_site(edited("  crs:", "  resolution: 2\n  crs:")).terrain()


def test_metadata_is_part_of_the_configuration_and_not_of_what_a_member_computes(edited):
    from runout.ensemble.member import plan_members

    before = plan_members(read_site(edited("title: A", "title: A")))
    site = read_site(edited("title: A", "metadata: {author: A. Name, email: name@example.org}\ntitle: A"))
    assert site.resolved()["metadata"] == {"author": "A. Name", "email": "name@example.org"}
    assert plan_members(site) == before
    with pytest.raises(ConfigError, match=r"name@example\.org"):
        read_site(edited("name@example.org", "nobody"))


def test_smoothing_averages_the_elevations_as_they_are_read_and_says_so(edited):
    site = read_site(edited("  crs:", "  smoothing: 25\n  crs:"))
    terrain = site.terrain()
    assert "averaged over a triangle of half-width 25 m along both axes (terrain.smoothing)" in terrain.changes
    ours = Terrain.from_raster(site.folder / "inputs" / "dem.asc").smoothed(25.0)
    np.testing.assert_array_equal(ours.elevation, terrain.elevation)


def test_another_smoothing_makes_other_members(edited):
    from runout.ensemble.member import plan_members

    plans = [plan_members(read_site(edited("  crs:", "  crs:")))]
    plans.append(plan_members(read_site(edited("  crs:", "  smoothing: 25\n  crs:"))))
    plans.append(plan_members(read_site(edited("smoothing: 25", "smoothing: 30"))))
    assert len({plan[0].key for plan in plans}) == 3


@pytest.mark.parametrize(
    ("length", "said"),
    [
        ("5", r"5 m averages nothing on cells of 10 m x 10 m; write 10 or more"),
        ("150", r"150 m is more than a third of a raster of 300 m x 200 m; write 66\.7 or less"),
        ("0", r"must be above 0"),
        ("-20", r"must be above 0"),
        ("rough", r"number"),
    ],
)
def test_a_smoothing_without_effect_or_too_long_is_refused(edited, length, said):
    with pytest.raises(ConfigError, match=rf"terrain\.smoothing: .*{said}"):
        read_site(edited("  crs:", f"  smoothing: {length}\n  crs:")).terrain()

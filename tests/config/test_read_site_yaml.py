"""Every problem of a site.yaml: its line, its key, its value and its remedy."""

import subprocess
import sys

import pytest
from refused_site import problems

from runout.config.read import load
from runout.config.site import read_site
from runout.errors import ConfigError


def test_valid_file_gives_stated_values_and_defaults(site_folder):
    settings = load(site_folder)
    assert settings.release[0].thickness == 4.0
    assert settings.material.law == "drucker_prager"
    assert settings.material.youngs_modulus == 5.0e6
    assert settings.simulation.cfl == 0.6
    assert settings.hazard.percentiles == [5.0, 50.0, 95.0]
    assert settings.ensemble.parameters["basal_friction_angle_deg"].high == 22.0


def test_misspelt_key_is_named_with_its_line_and_the_nearest_right_one(edited):
    folder = edited("  crs:", "  resolutoin: 5\n  crs:")
    assert problems(folder) == ["site.yaml:5: terrain.resolutoin: unknown key; did you mean 'resolution'?"]


def test_key_in_the_wrong_section_is_sent_to_the_right_one(edited):
    folder = edited("  end_time: 30", "  end_time: 30\n  friction_angle_deg: 30")
    assert problems(folder) == ["site.yaml:18: simulation.friction_angle_deg: unknown key; it belongs under 'material'"]


def test_all_problems_are_listed_at_once_in_the_order_of_the_file(edited):
    edited("  crs: EPSG:32632", "  crs: EPSG:99999999\n  resolutoin: 5")
    edited("thickness: 4.0", "thickness: -4.0")
    edited("density: 2000", "density: 2.0")
    edited("cell_size: 10", "cell_size: ten")
    folder = edited("members: 4", "members: 4.5")
    found = problems(folder)
    assert [line.split(": ")[1] for line in found] == [
        "terrain.crs",
        "terrain.resolutoin",
        "release[0].thickness",
        "material.density",
        "simulation.cell_size",
        "ensemble.members",
    ]
    assert [int(line.split(":")[1]) for line in found] == [5, 6, 10, 12, 17, 20]


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("thickness: 4.0", "thickness: -4.0", 9, "-4 m is out of range; it must be at least 1e-05 m"),
        ("thickness: 4.0", "thickness: 0", 9, "0 m is out of range"),
        ("    thickness: 4.0\n", "", 7, "polygons without thickness and volume; add thickness: [m] or volume: [m3]"),
        ("thickness: 4.0", "thickness: 4\n    raster: inputs/dem.asc", 7, "polygons and raster are both given"),
        ("thickness: 4.0", "thickness: 4\n    sign: negative", 10, "has no meaning with polygons"),
        ("thickness: 4.0", "thickness: 4\n    edge: vertcal", 10, "did you mean 'vertical'?"),
        ("thickness: 4.0", "volume: 1.0e+13", 9, "1e+13 m3 is out of range; it must be at least 1e-09 and at most 1e+12 m3"),
        (
            "polygons: inputs/release.geojson\n    thickness: 4.0",
            "raster: inputs/dem.asc\n    edge: tapered",
            9,
            "has no meaning with a raster",
        ),
        ("thickness: 4.0", "thickness: 4\n    placement: excavted", 10, "did you mean 'excavated'?"),
        ("density: 2000", "density: 2.0", 11, "2 kg m-3 is out of range; it must be at least 100 and at most 5000 kg m-3; 2 g/cm3"),
        ("youngs_modulus: 5.0e6", "youngs_modulus: 5", 12, "5 Pa is out of range"),
        ("youngs_modulus: 5.0e6", 'youngs_modulus: "5e6"', 12, "'5e6' is text; a number or auto is needed; remove the quotes"),
        (
            "youngs_modulus: 5.0e6",
            "youngs_modulus: 5 MPa",
            12,
            "a number or auto is needed; write 5; the unit is always Pa",
        ),
        ("youngs_modulus: 5.0e6", "youngs_modulus: .inf", 12, "a finite number or auto is needed"),
        ("youngs_modulus: 5.0e6", "youngs_modulus:", 12, "has no value; a number or auto is needed"),
        ("youngs_modulus: 5.0e6", "youngs_modulus: Auto", 12, "'Auto' is text; a number or auto is needed"),
        ("youngs_modulus: 5.0e6", "wave_ratio: 2.5", 12, "2.5 is out of range; it must be at least 3 and at most 20; 4 is usual"),
        ("youngs_modulus: 5.0e6", "weight_strain: 1", 12, "1 is out of range; it must be at least 0.001 and at most 0.03"),
        ("youngs_modulus: 5.0e6", "youngs_modulus: 5.0e6\n  wave_ratio: 5", 10, "wave_ratio is 5 and youngs_modulus 5e+06 Pa"),
        ("  friction_angle_deg: 30\n", "", 10, "required key is missing; add it: internal friction angle"),
        ("friction_angle_deg: 30", "friction_angle_deg: 0", 10, "such a material has no strength"),
        ("  density: 2000", "  law: drucker_praguer", 11, "did you mean 'drucker_prager'?"),
        ("\nbasal_friction_angle_deg: 20", "\nbasal_friction_angle_deg: 75", 14, "it must be at least 0 and at most 60 deg"),
        ("cell_size: 10", "cell_size: [10, 10]", 16, "a list of 2; 3 values are needed"),
        ("cell_size: 10", "cell_size: yes", 16, "'yes' is text; a number or a list is needed"),
        ("end_time: 30", "end_time: true", 17, "true is a yes or no; a number is needed"),
        ("end_time: 30", "end_time:", 17, "has no value; a number is needed"),
        ("end_time: 30", "end_time: 30\n  cfl: 0.9", 18, "0.9 is out of range; it must be above 0 and at most 0.6; 0.6 is usual"),
        ("end_time: 30", "end_time: 30\n  device: cuda:0", 18, "runs on the CPU only"),
        ("end_time: 30", "end_time: 30\n  precision: flaot32", 18, "'flaot32' is not known; did you mean 'float32'?"),
        ("end_time: 30", "end_time: 30\n  transfer: aflip", 18, "unknown key; it was taken away; remove the key; use substeps: 4"),
        ("end_time: 30", "end_time: 30\n  flip_ratio: 0.9", 18, "unknown key; it was taken away; remove the key; use substeps: 4"),
        ("end_time: 30", "end_time: 30\n  f_bar: true", 18, "unknown key; it was taken away; remove the key"),
        ("end_time: 30", "end_time: 30\n  sleep_speed: 0.1", 18, "unknown key; it was taken away; remove the key; masses at"),
        ("end_time: 30", "end_time: 30\n  particles_per_cell: 0", 18, "0 is out of range; it must be at least 1"),
        ("members: 4", "members: 0", 19, "0 is out of range; it must be at least 1"),
        ("name: slope", "name: a slope", 1, "letters, digits, - and _"),
        ("title: A tilted plane", "hazard: {percentiles: [0.05, 0.5]}", 2, "percentiles are in percent here; write 5 for 0.05"),
        ("title: A tilted plane", "hazard: {thickness_thresholds: [1, 0.5]}", 2, "does not rise"),
        (
            "title: A tilted plane",
            "hazard: {pressure_thresholds: [3]}",
            2,
            "it must be at least 100 Pa; 3 kPa",
        ),
        ("title: A tilted plane", "hazard: {thickness_thresholds: []}", 2, "a list of 0; 1 value is needed"),
        ("title: A tilted plane", "hazard: {momentum_flux_thresholds: [0]}", 2, "it must be above 0 m3 s-2"),
        ("title: A tilted plane", "hazard: {joint: [{thickness: 1, sped: 2}]}", 2, "unknown key; did you mean 'speed'?"),
        ("title: A tilted plane", "hazard: {joint: [{thickness: 1}]}", 2, "only thickness has a threshold; give two or more of"),
        ("title: A tilted plane", "hazard: {joint: [{speed: 1, pressure: 3}]}", 2, "it must be at least 100 Pa; 3 kPa"),
        ("title: A tilted plane", "hazard: {joint: {speed: 1, thickness: 3}}", 2, "a list such as"),
        ("title: A tilted plane", "hazard: {joint: [{speed: 1, deposit: 3}, {deposit: 3.0, speed: 1}]}", 2, "is listed twice"),
        ("title: A tilted plane", "budget: {hours: -1}", 2, "-1 h is out of range"),
    ],
)
def test_wrong_value_is_refused_with_its_line_and_a_remedy(edited, old, new, line, said):
    found = problems(edited(old, new))
    assert len(found) == 1
    assert found[0].startswith(f"site.yaml:{line}: ")
    assert said in found[0]


@pytest.mark.parametrize("place", ["\nbasal_friction_angle_deg: 20", "  friction_angle_deg: 30"])
def test_angle_in_radians_is_suspected_and_the_degrees_are_offered(edited, place):
    (found,) = problems(edited(place, place.split(":")[0] + ": 0.35"))
    assert "0.35 deg is suspiciously small; angles are in degrees here; write 20.1 if it is 0.35 radians" in found


DISTRIBUTION = "{distribution: uniform, low: 12, high: 22}"


@pytest.mark.parametrize(
    ("distribution", "key", "said"),
    [
        ("{distribution: uniform, low: 22, high: 12}", ".low", "low (22) is not below high (12)"),
        ("{distribution: uniform, low: 20, high: 20}", ".low", "low (20) is not below high (20)"),
        ("{distribution: unifrom, low: 12, high: 22}", ".distribution", "did you mean 'uniform'?"),
        ("{low: 12, high: 22}", ".distribution", "choose one of uniform, triangular, normal, discrete"),
        ("{distribution: uniform, low: 12}", ".high", "required key is missing"),
        ("{distribution: uniform, low: 12, high: 22, mean: 17}", ".mean", "unknown key; choose among distribution, low, high"),
        (
            "{distribution: uniform, low: 12, high: 70}",
            "",
            "it can give 70 deg; the parameter must be at least 0",
        ),
        ("{distribution: uniform, low: 0.2, high: 0.4}", "", "write 22.9 if it is 0.4 radians"),
        ("{distribution: uniform, low: 1, high: 4}", "", "it can give angles below 1.57 deg, which are taken for radians"),
        ("{distribution: triangular, low: 10, mode: 30, high: 20}", ".mode", "mode (30) is not between low (10) and high (20)"),
        ("{distribution: normal, mean: 17, standard_deviation: 0}", ".standard_deviation", "it must be above 0"),
        ("{distribution: normal, mean: 17, standard_deviation: 9}", "", "it can give -19 deg"),
        (
            "{distribution: normal, mean: 17, standard_deviation: 1, high: 2}",
            ".high",
            "more than 4 standard deviations",
        ),
        ("{distribution: discrete, values: [12, 15], frequencies: [1]}", ".frequencies", "1 frequencies for 2 values"),
        ("{distribution: discrete, values: [12, 15], frequencies: [1, 0]}", ".frequencies[1]", "it must be above 0"),
        ("{distribution: discrete, values: [12, 15], frequencies: [0.5, 0.2]}", ".frequencies", "add up to 0.7, not to 1"),
        ("{distribution: discrete, values: [12, 15], frequencies: [0.9, 0.9]}", ".frequencies", "add up to 1.8, not to 1"),
        ("{distribution: discrete, values: [12, 12], frequencies: [1, 1]}", ".values", "a value is listed twice"),
        ("17", "", "17 is a number; a block is needed; write {distribution: uniform, ...}"),
    ],
)
def test_distribution_that_makes_no_sense_is_refused(edited, distribution, key, said):
    (found,) = problems(edited(DISTRIBUTION, distribution))
    assert found.startswith(f"site.yaml:21: ensemble.parameters.basal_friction_angle_deg{key}: ")
    assert said in found


def test_cut_normal_distribution_is_accepted(edited):
    cut = "{distribution: normal, mean: 17, standard_deviation: 9, low: 5, high: 30}"
    parameter = load(edited(DISTRIBUTION, cut)).ensemble.parameters["basal_friction_angle_deg"]
    assert (parameter.low, parameter.high) == (5.0, 30.0)


def test_parameter_that_cannot_be_sampled_is_named(edited):
    (found,) = problems(edited("    basal_friction_angle_deg: {", "    basal_frictoin_angle_deg: {"))
    assert "unknown key; did you mean 'basal_friction_angle_deg'?" in found


def test_angle_of_one_release_contradicts_the_sampled_one(edited):
    (found,) = problems(edited("thickness: 4.0", "thickness: 4.0\n    basal_friction_angle_deg: 15"))
    assert found == "site.yaml:10: release[0].basal_friction_angle_deg: the ensemble samples this angle too; remove one of the two"


def test_sampling_the_strength_of_an_elastic_material_is_refused(edited):
    edited("  friction_angle_deg: 30\n", "  law: elastic\n")
    (found,) = problems(edited("    basal_friction_angle_deg: {", "    cohesion: {"))
    assert "ensemble.parameters.cohesion: the law elastic has no such parameter" in found


def test_two_releases_of_one_name_are_refused(edited):
    again = "thickness: 4.0\n  - name: scar\n    polygons: inputs/release.geojson\n    volume: 100"
    (found,) = problems(edited("thickness: 4.0", again))
    assert found.startswith("site.yaml:10: release[1].name: two releases are called 'scar'")


def test_missing_input_is_named_with_the_nearest_existing_file(edited):
    (found,) = problems(edited("inputs/dem.asc", "inputs/demm.asc"))
    assert found == "site.yaml:4: terrain.dem: there is no file 'inputs/demm.asc'; did you mean 'inputs/dem.asc'?"


def test_input_named_without_its_folder_is_found_below(edited):
    (found,) = problems(edited("inputs/release.geojson", "release.geojson"))
    assert found.endswith("there is no file 'release.geojson'; did you mean 'inputs/release.geojson'?")


def test_unknown_sample_raster_is_refused(edited):
    (found,) = problems(edited("inputs/dem.asc", "matplotlib:grand_canyon"))
    assert "the only one is 'matplotlib:jacksboro_fault_dem'" in found


def test_public_file_with_a_wrong_checksum_text_is_refused(edited):
    (found,) = problems(edited("inputs/dem.asc", "{url: 'https://example.org/dem.asc', sha256: abc, size: 10}"))
    assert found.startswith("site.yaml:4: terrain.dem.sha256: 'abc' cannot be used; 64 digits")


def test_repeated_key_is_refused_and_both_lines_are_named(edited):
    (found,) = problems(edited("title: A tilted plane", "title: A tilted plane\nname: again"))
    assert found == "site.yaml:3: name: this key was already given on line 1; keep one of the two"


def test_tab_is_named_as_the_cause_of_a_syntax_error(edited):
    (found,) = problems(edited("  dem: inputs/dem.asc", "\tdem: inputs/dem.asc"))
    assert found.startswith("site.yaml:4: not valid YAML")
    assert "indent with spaces, not with tabs" in found


def test_missing_colon_is_a_syntax_error_with_its_line(edited):
    (found,) = problems(edited("  density: 2000", "  density 2000"))
    assert found.startswith("site.yaml:1")
    assert "not valid YAML" in found


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "the file is empty"),
        (b"- a\n- b\n", "the file holds no `key: value` lines"),
        (b"name: caf\xe9\n", "site.yaml:1: this is not UTF-8 text"),
        (b"name: &a\n  b: *a\n", "nested too deeply, or an alias that holds itself"),
        (b"name: a\n? [1, 2]\n: 3\n", "site.yaml:2: a key must be a word"),
        (b"name: a\ntitle: \x07\n", "site.yaml:2: a control character stands here"),
    ],
)
def test_file_that_is_no_configuration_is_refused(site_folder, content, said):
    (site_folder / "site.yaml").write_bytes(content)
    assert said in "\n".join(problems(site_folder))


def test_missing_site_is_named_with_the_nearest_folder(site_folder):
    with pytest.raises(ConfigError, match=r"no such site; did you mean .*slope\?"):
        load(site_folder.with_name("slop"))


def test_folder_of_sites_is_refused_with_their_names(site_folder):
    with pytest.raises(ConfigError, match=r"holds no site\.yaml; name one of its sites: slope"):
        load(site_folder.parent)


def test_reading_a_site_imports_no_heavy_library(site_folder):
    code = f"import sys, runout; runout.read_site({str(site_folder)!r}); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "pydantic" in loaded
    assert not {"numba", "rasterio", "geopandas", "xarray", "matplotlib", "pandas"} & set(loaded)


GRAINS = "  law: granular_flow\n  static_friction: 0.38\n  dynamic_friction: 0.64\n  grain_size: 0.02\n"


def test_friction_that_rises_with_the_rate_is_a_law_of_a_site(edited):
    folder = edited("  friction_angle_deg: 30\n", GRAINS)
    material = read_site(folder).material()
    assert (material.law, material.static_friction, material.grain_size) == ("granular_flow", 0.38, 0.02)
    assert material.inertial_constant == 0.3


def test_friction_that_does_not_rise_is_refused(edited):
    (found,) = problems(edited("  friction_angle_deg: 30\n", GRAINS.replace("0.64", "0.3")))
    assert "dynamic_friction is 0.3, not above static_friction 0.38; friction rises with the rate" in found


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        (
            "members: 64\n  tolerance: 0",
            "20: ensemble.tolerance: 0 is out of range; it must be above 0 and at most 0.2; it is a probability",
        ),
        ("members: 64\n  tolerance: 2", "site.yaml:20: ensemble.tolerance: 2 is out of range; it must be above 0 and at most 0.2"),
        ("members: 64\n  tolerance: small", "site.yaml:20: ensemble.tolerance: 'small'"),
        (
            "members: 100\n  tolerance: 0.02",
            "19: ensemble.members: 100 with tolerance, where it is a power of two from 16",
        ),
        ("members: 8\n  tolerance: 0.02", "set it to 16"),
        ("members: 70000\n  tolerance: 0.02", "set it to 65536"),
        ("tolerance: 0.02", "site.yaml:18: ensemble.members: 1 with tolerance"),
        ("members: 100\n  tolerance: 0.02", "set it to 128"),
    ],
)
def test_a_tolerance_that_no_ensemble_can_meet_is_refused(edited, stated, said):
    (found,) = problems(edited("members: 4", stated))
    assert said in found


def test_a_tolerance_without_sampled_parameters_is_refused(edited):
    edited(DISTRIBUTION, "")
    folder = edited("members: 4\n  parameters:\n    basal_friction_angle_deg: \n", "members: 64\n  tolerance: 0.02\n")
    assert problems(folder) == [
        "site.yaml:20: ensemble.tolerance: no parameters are sampled, so that members differ by their seeds only; "
        "remove it, or add parameters"
    ]


def test_a_tolerance_is_read(edited):
    ensemble = load(edited("members: 4", "members: 64\n  tolerance: 0.02")).ensemble
    assert (ensemble.members, ensemble.tolerance) == (64, 0.02)

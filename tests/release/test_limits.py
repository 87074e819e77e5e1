"""One limit for every way to state a quantity: number, attribute, raster, array; site.yaml and Python."""

import math
from dataclasses import replace

import numpy as np
import pandas
import pytest
import shapely

import runout
from runout.config.material import OF_THE_RUN, settings_of
from runout.config.schema import SimulationSettings
from runout.errors import ConfigError, InputError, MaterialError, ReleaseError
from runout.model.laws import LAWS
from runout.model.limits import LIMITS, checked
from runout.model.release import Release

SQUARE = shapely.box(50.0, 50.0, 100.0, 100.0)
SAND = {"density": 2000.0, "youngs_modulus": 5e6, "friction_angle": 30.0}
ABSURD = [0.0, -3.0, 1e-300, 1001.0, 1e300, math.nan, math.inf]


@pytest.mark.parametrize("thickness", [*ABSURD, True])
def test_thickness_by_number_is_refused_beyond_its_limit(write_polygons, terrain, thickness):
    with pytest.raises(ReleaseError, match=r"release.gpkg: thickness is .* must be"):
        Release.from_vector(write_polygons([SQUARE]), terrain, thickness=thickness)


@pytest.mark.parametrize("volume", [*ABSURD[:3], 1e13, *ABSURD[4:], "1e5", True])
def test_volume_is_refused_beyond_its_limit(write_polygons, terrain, volume):
    with pytest.raises(ReleaseError, match=r"volume is .* must be"):
        Release.from_vector(write_polygons([SQUARE]), terrain, volume=volume)
    with pytest.raises(ReleaseError, match=r"volume is .* must be"):
        Release.from_array(np.ones(terrain.shape), terrain, volume=volume)


def test_thickness_of_an_attribute_is_refused_beyond_the_same_limit(write_polygons, terrain):
    path = write_polygons([SQUARE, shapely.box(0, 0, 10, 10)], depth=[2.0, 1e300])
    with pytest.raises(
        ReleaseError, match=r"attribute 'depth' of polygon 2 is 1e\+300 m; it must be at least 1e-05 and at most 1000 m"
    ):
        Release.from_vector(path, terrain, thickness="depth")


@pytest.mark.parametrize("values", [pandas.to_datetime(["2024-05-01"]), [True], ["deep"]])
def test_attribute_that_is_a_date_or_no_number_is_refused(write_polygons, terrain, values):
    with pytest.raises(ReleaseError, match=r"attribute 'when' of polygon 1 is .*; every polygon needs a number for its thickness"):
        Release.from_vector(write_polygons([SQUARE], when=values), terrain, thickness="when")


@pytest.mark.parametrize("marker", [-9999.0, 3.4e38, 1e20, -32768.0])
@pytest.mark.parametrize("sign", ["positive", "negative"])
def test_undeclared_nodata_in_a_thickness_raster_is_named_with_its_cell(write_raster, terrain, marker, sign):
    values = np.zeros(terrain.shape)
    values[20:22, 30] = 3.0 if sign == "positive" else -3.0
    values[5, 7] = marker
    with pytest.raises(ReleaseError, match=rf"at easting 500037.50, .*gdal_edit.py -a_nodata {marker:.9g}".replace("+", r"\+")):
        Release.from_raster(write_raster(values), terrain, sign=sign)


def test_thickness_array_has_the_limit_of_a_raster(terrain):
    values = np.ones(terrain.shape)
    values[3, 4] = 1e5
    with pytest.raises(ReleaseError, match=r"thickness is 100000 m at row 3, column 4 .* at most 1000 m"):
        Release(values, terrain)
    with pytest.raises(ReleaseError, match="thickness is 1e-300 m at most; it must be at least 1e-05"):
        Release(np.full(terrain.shape, 1e-300), terrain)


@pytest.mark.parametrize("kind", [bool, complex, str, "datetime64[s]"])
def test_thickness_array_of_another_type_is_refused(terrain, kind):
    with pytest.raises(ReleaseError, match=r"thickness is an array of .*; an array of real numbers is needed"):
        Release.from_array(np.ones(terrain.shape, int).astype(kind), terrain)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("density", 2.0, "2 g/cm3 is 2000"),
        ("density", "2000", "must be a number in kg m-3"),
        ("youngs_modulus", 5.0, "5 MPa is 5.0e6"),
        ("friction_angle", 0.52, "angles are in degrees here; write 29.8 if it is 0.52 radians"),
        ("cohesion", 1e10, "at most 1e"),
    ],
)
def test_python_refuses_the_material_that_site_yaml_refuses(key, value, said):
    with pytest.raises(MaterialError, match=f"{key} is .*{said}"):
        runout.DruckerPrager(**{**SAND, key: value})


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ({"basal_friction_angle": 0.35}, "write 20.1 if it is 0.35 radians"),
        ({"basal_friction_angle": 75.0}, "basal_friction_angle is 75 deg; it must be at least 0 and at most 60 deg"),
        ({"cell_size": 1e300}, "cell_size is .* at most 1000 m"),
        ({"cell_size": (2.0, 2.0, -1.0)}, "cell_size is -1 m"),
        ({"end_time": 1e9}, "end_time is 1e.09 s; it must be .* at most 86400 s"),
        ({"cfl": "0.5"}, "cfl is '0.5'; it must be a number"),
        ({"arrival_threshold": math.nan}, "arrival_threshold is nan"),
    ],
)
def test_python_refuses_the_run_that_site_yaml_refuses(terrain, choice, said):
    mass = np.zeros(terrain.shape)
    mass[18:22, 28:32] = 3.0
    arguments = {"cell_size": 5.0, "end_time": 1.0, "basal_friction_angle": 20.0} | choice
    with pytest.raises(InputError, match=said):
        runout.simulate(terrain, Release(mass, terrain), runout.DruckerPrager(**SAND), **arguments)


def test_angle_of_a_release_in_radians_is_refused(write_polygons, terrain):
    with pytest.raises(ReleaseError, match=r"basal_friction_angle_deg is 0.3 deg, .* write 17.2"):
        Release.from_vector(write_polygons([SQUARE]), terrain, thickness=1.0, basal_friction_angle_deg=0.3)


@pytest.mark.parametrize("angle", [20, 20.0, -0.1, "20", True, math.nan, math.radians(60.1)])
def test_a_release_refuses_friction_angles_that_are_not_radians(terrain, angle):
    with pytest.raises(ReleaseError, match="basal_friction_angle is") as caught:
        Release(np.ones(terrain.shape), terrain, basal_friction_angle=angle)
    assert ("math.radians(20)" in str(caught.value)) == (angle in (20, "20") or angle is True or angle != angle)


@pytest.mark.parametrize("angle", [0, np.float32(0.35), math.radians(60.0)])
def test_a_friction_angle_of_any_type_of_number_stays_an_angle(terrain, angle):
    """A number that is not a float would count as a coefficient."""
    release = Release(np.ones(terrain.shape), terrain, basal_friction_angle=angle)
    assert type(release.friction_on(0.1)) is float
    assert release.friction_on(0.1) == angle


@pytest.mark.parametrize("friction", [20, 0.36, "coulomb", runout.Coulomb])
def test_friction_that_is_no_law_is_refused_with_its_remedy(terrain, material, friction):
    release = Release(np.ones(terrain.shape), terrain)
    with pytest.raises(ConfigError, match=r"basal_friction is .*Coulomb\(friction_angle=20.0\) in degrees"):
        runout.simulate(terrain, release, material, cell_size=5.0, end_time=1.0, basal_friction=friction)
    with pytest.raises(ReleaseError, match=r"basal_friction is .*math.radians\(20\)"):
        replace(release, basal_friction=friction)


def test_arguments_of_another_kind_are_refused_by_name(terrain, material):
    release = Release(np.ones(terrain.shape), terrain)
    with pytest.raises(ConfigError, match="material is 30; give a material"):
        runout.simulate(terrain, release, 30, cell_size=5.0, end_time=1.0)
    for name in ("friction_zones", "structures"):
        with pytest.raises(ConfigError, match=f"{name} is 30; give "):
            runout.simulate(terrain, release, material, cell_size=5.0, end_time=1.0, **{name: 30})
    with pytest.raises(ReleaseError, match="material is 30; give a material"):
        replace(release, material=30)


def test_a_coefficient_of_zones_that_is_an_angle_in_degrees_is_refused():
    ones = np.ones((3, 4))
    with pytest.raises(ConfigError, match=r"coefficient of a friction zone is 20.*tan\(math.radians\(20\)\)"):
        runout.FrictionZones(ones, 20 * ones, (5.0, 5.0))
    assert runout.FrictionZones(ones, math.tan(math.radians(60)) * ones, (5.0, 5.0)).factor.shape == (3, 4)


def test_settings_and_python_have_one_table_of_ranges():
    shared = {name: field for name, field in SimulationSettings.model_fields.items() if name in LIMITS and name != "cell_size"}
    assert len(shared) >= 4
    for name, field in shared.items():
        valid = LIMITS[name]
        assert bounds_of(field) == valid.bounds(), name
        with pytest.raises(ConfigError, match=f"it must be .* at most {valid.high:g}".replace("+", r"\+")):
            checked(name, 2 * valid.high + 1, error=ConfigError)
    assert set(OF_THE_RUN.values()) <= set(LIMITS.values())


@pytest.mark.parametrize("law", LAWS.of_runout(), ids=lambda law: law.name)
def test_settings_and_python_have_the_ranges_that_a_law_declares(law):
    numbers = [p for p in law.parameters if p.valid]
    assert len(numbers) >= 3
    for p in numbers:
        assert bounds_of(settings_of(law).model_fields[p.key]) == p.valid.bounds(), p.name
        with pytest.raises(MaterialError, match=f"{p.name} is .* at most {p.valid.high:g}".replace("+", r"\+")):
            replace(law.example, **{p.name: 2 * p.valid.high + 1})


def bounds_of(field):
    return {key: getattr(m, key) for m in field.metadata for key in ("gt", "ge", "le") if getattr(m, key, None) is not None}

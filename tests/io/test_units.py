"""Units and packing of rasters: what their words mean, and that they count."""

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

import runout
from runout.errors import ObservationError, ReleaseError
from runout.io.units import factor_to, is_stated, metres_in
from runout.scores.read import read_map

GRID = from_origin(500_000, 5_000_040, 10, 10)
STORED = np.array([[0, 0, 0, 0], [0, 3, 5, 0], [0, 2, 4, 0], [0, 0, 0, 0]])


def write(path, stored=STORED, unit="", scale=1.0, **profile):
    profile = {"driver": "GTiff", "height": 4, "width": 4, "count": 1, "dtype": "int16", "crs": "EPSG:32632", **profile}
    with rasterio.open(path, "w", transform=GRID, **profile) as file:
        file.write(stored.astype(profile["dtype"]), 1)
        file.set_band_unit(1, unit)
        file.scales = (scale,)
    return path


@pytest.mark.parametrize(("unit", "scale", "metres"), [("ft", 1.0, 0.3048), ("cm", 10.0, 0.1), ("", 0.5, 0.5), ("m", 1.0, 1.0)])
def test_thickness_counts_in_the_unit_and_packing_that_its_raster_states(tmp_path, unit, scale, metres):
    path = write(tmp_path / "thickness.tif", unit=unit, scale=scale)
    terrain = runout.Terrain.from_array(np.full((4, 4), 100.0), 10.0, "EPSG:32632", (500_000, 5_000_000))
    release = runout.Release.from_raster(path, terrain, placement="on_surface")
    assert release.thickness == pytest.approx(STORED * metres)
    values, _, said = read_map(path)
    assert values == pytest.approx(STORED * metres)
    assert len(said) == (unit not in ("", "m")) + (scale != 1.0) == len(release.changes)


def test_undeclared_mark_of_a_scaled_raster_is_the_stored_number(tmp_path):
    terrain = runout.Terrain.from_array(np.full((4, 4), 100.0), 10.0, "EPSG:32632", (500_000, 5_000_000))
    with pytest.raises(ReleaseError, match="a_nodata 32000"):
        runout.Release.from_raster(write(tmp_path / "t.tif", np.where(STORED, STORED, 32000), scale=0.1), terrain)


def test_pressure_in_kpa_and_speed_in_km_h_become_si_and_another_unit_is_refused(tmp_path):
    path = write(tmp_path / "map.tif", unit="kPa")
    assert read_map(path, quantity="pressure")[0].max() == 5000.0
    with pytest.raises(ObservationError, match=r"kPa.*gdal_edit\.py -units"):
        read_map(path, quantity="speed")
    assert read_map(write(tmp_path / "map.tif", unit="km/h"), quantity="speed")[0].max() == pytest.approx(5 / 3.6)


METRES = """
m|M|metre|METERS|Meters|[m]|(m)|m.|m a.s.l.|m.a.s.l.|masl|mASL|m AMSL|meters above sea level|METERS ABOVE SEA LEVEL|mOD
m NHN|mNN|mNHN|m+NAP|m + NAP|m ü. NN|Meter über NN|Meter ü. NHN|m ü. M.|m.ü.M.|müM|m ü. A.|mètres|mètres NGF|metros|msnm
m s.n.m.|metros sobre el nivel del mar|metri s.l.m.|mslm|m s. l. m.|metri sul livello del mare|metrów n.p.m.|m n. m.
метры над уровнем моря|メートル|m (orthometric)|m above ellipsoid|m (WGS84 ellipsoid)|m NAVD88|m NAVD 88|m DHHN2016|m.o.h.
m Baltic 1977|m (EPSG:5773)|Elevation (m)|elevation in metres|metres above mean sea level (EGM2008)|meters, NAVD88|moh|mLN02
m_above_sea_level|m NGF-IGN69|meter boven NAP|m TAW|mAHD
"""
FEET = """
ft|feet|Foot|feet (NAVD88)|ft NAVD88|ftNAVD88|ft MSL|feet above sea level|international foot|International feet|pieds|Fuß|ft.
"""
SURVEY_FEET = """
US survey foot|us-ft|ftUS|foot_us|US_survey_foot|U.S. feet|survey foot|Foot (US survey)|sft|US survey feet (NAVD88)|us_ft
"""
OTHER = """
m/s|m s-1|m s|ms|m2|m^2|m²|m3|10 m|0.1 m|m*10|m x 10|m/10|m below sea level|m above ground|m depth|miles|mi|yards|furlong
m or ft|feet m|m per second|METERS PER SECOND|Meters Squared|degrees|hPa|mbar|um|µm|nm|inch|ft2|feet/m|min|months|mol|mV
MHz|percent|m-1|Fathoms|Fathoms MSL|kft|m foo
"""
CENTIMETRES = "cm|Zentimeter|centimètres"


def words(text):
    return [word for line in text.strip().split("\n") for word in line.split("|")]


@pytest.mark.parametrize(
    ("text", "metres"),
    [(METRES, 1.0), (FEET, 0.3048), (SURVEY_FEET, 1200 / 3937), ("cm|Zentimeter|centimètres", 0.01), ("km", 1000.0)],
)
def test_a_word_for_a_length_and_words_on_its_datum_are_that_length(text, metres):
    assert {word: metres_in(word) for word in words(text)} == dict.fromkeys(words(text), metres)


def test_no_other_unit_is_taken_for_a_length():
    assert {word: metres_in(word) for word in words(OTHER)} == dict.fromkeys(words(OTHER))
    assert all(is_stated(word) for word in words(OTHER))


@pytest.mark.parametrize("text", [None, "", "unknown", "1", "Unspecified", "MSL", "mean sea level", "NAVD88", "NHN"])
def test_a_datum_alone_states_no_unit(text):
    assert not is_stated(text)
    assert factor_to("m", text) == factor_to("Pa", text) == 1.0


def test_units_of_other_quantities_are_those_of_their_kind():
    assert (
        factor_to("m/s2", "m s**-2")
        == factor_to("m/s2", "m/s^2")
        == factor_to("deg", "Degrees")
        == factor_to("kg/m3", "kg/m3")
        == 1.0
    )
    assert factor_to("deg", "radians") == pytest.approx(57.29577951308232)
    assert factor_to("", "deg") is factor_to("deg", "m") is factor_to("m/s2", "m") is factor_to("Pa", "m/s") is None


def test_a_change_of_a_thickness_raster_is_logged_once(tmp_path, caplog):
    terrain = runout.Terrain.from_array(np.full((4, 4), 100.0), 10.0, "EPSG:32632", (500_000, 5_000_000))
    with caplog.at_level("WARNING"):
        runout.Release.from_raster(write(tmp_path / "thickness.tif", unit="ft"), terrain, placement="on_surface")
    assert caplog.text.count("multiplied by 0.3048") == 1

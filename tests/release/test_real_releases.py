"""Releases of real events."""

import numpy as np
import pytest
import shapely

from runout.errors import ReleaseError
from runout.model.release import Release

CASCADES = "cascades_2021_landlab"


def test_frank_slide_holds_36_million_cubic_metres(real_data, real_terrain):
    terrain = real_terrain("frank_slide_1903/Frankslide_topography.asc")
    release = Release.from_raster(real_data / "frank_slide_1903/Frankslide_pile.asc", terrain, volume=36.0e6)
    assert release.volume == pytest.approx(36.0e6, rel=1e-14)
    assert release.thickness.max() == pytest.approx(183.5, abs=0.1)


def test_cascades_landslide_is_stored_negative(real_data, real_terrain):
    terrain, path = real_terrain(f"{CASCADES}/pre_runout_DEM.asc"), real_data / CASCADES / "landslide_depth.asc"
    with pytest.raises(ReleaseError, match=r"all 30 cells .* sign='negative'"):
        Release.from_raster(path, terrain)
    release = Release.from_raster(path, terrain, sign="negative")
    assert release.volume == pytest.approx(22_481.0, rel=1e-4)
    assert release.area == 3000.0


def test_difference_of_elevation_is_no_release(real_data, real_terrain):
    terrain = real_terrain(f"{CASCADES}/pre_runout_DEM.asc")
    with pytest.raises(ReleaseError, match="erosion and deposition"):
        Release.from_raster(real_data / CASCADES / "DEM_of_Difference.asc", terrain)


def test_avaframe_shapefile_gives_its_thickness(real_data, real_terrain):
    path = real_data / "avaframe/avaKot/Inputs/REL/relKot.shp"
    terrain = real_terrain("avaframe/avaKot/Inputs/avaKot.asc", "EPSG:31287")
    release = Release.from_vector(path, terrain, thickness="thickness", edge="vertical")
    assert release.volume == pytest.approx(15_188.056852, rel=1e-9)
    assert release.thickness.max() == pytest.approx(1.0, rel=1e-12)
    with pytest.raises(ReleaseError, match="lies outside the terrain"):  # whose system was stated wrongly
        Release.from_vector(path, real_terrain("avaframe/avaKot/Inputs/avaKot.asc", "EPSG:31254"), thickness="thickness")


def test_maipo_polygons_agree_with_polygon_clipping_cell_by_cell(real_data, real_terrain):
    terrain = real_terrain("maipo_debrisflow_runoptGPP/elev_12_5m.tif")
    release = Release.from_vector(
        real_data / "maipo_debrisflow_runoptGPP/dflow_runout_ply.shp", terrain, thickness=1.0, edge="vertical"
    )
    east, north = np.meshgrid(terrain.easting, terrain.northing)
    cells = shapely.box(east - 6.25, north - 6.25, east + 6.25, north + 6.25)
    cut = (release.thickness > 0) & (release.thickness < 1)
    exact = shapely.area(shapely.intersection(cells[cut], release.outline)) / terrain.cell_area
    np.testing.assert_allclose(release.thickness[cut], exact, atol=1e-8)
    assert release.volume == pytest.approx(1_894_354.947, rel=1e-9)
    with pytest.raises(ReleaseError, match="holds Point"):
        Release.from_vector(real_data / "maipo_debrisflow_runoptGPP/dflow_source_pnt.shp", terrain, thickness=1.0)

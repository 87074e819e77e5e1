"""A picture on the ground."""

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_bounds

from runout.errors import InputError
from runout.io.draped_image import draped_image

CRS, EXTENT = "EPSG:32632", (500_000.0, 5_000_000.0, 500_400.0, 5_000_200.0)


def write(path, bands, extent=EXTENT, crs=CRS):
    count, height, width = bands.shape
    profile = {"driver": "GTiff", "count": count, "height": height, "width": width, "dtype": bands.dtype, "crs": crs}
    with rasterio.open(path, "w", transform=from_bounds(*extent, width, height), **profile) as file:
        file.write(bands)
    return path


def corners(image):
    return [tuple(int(v) for v in image[row, column]) for row in (5, -5) for column in (5, -5)]


def test_an_image_lies_north_up_on_the_window(tmp_path):
    bands = np.zeros((3, 20, 40), np.uint8)
    bands[0, :10, :20] = bands[1, :10, 20:] = bands[2, 10:, :20] = 250
    image = draped_image(write(tmp_path / "a.tif", bands), EXTENT, CRS)
    assert image.shape == (1024, 2048, 3)
    assert corners(image) == [(250, 0, 0), (0, 250, 0), (0, 0, 250), (0, 0, 0)]


def test_an_image_in_another_system_and_of_one_band_is_reprojected_and_stretched(tmp_path):
    from rasterio.warp import transform_bounds

    wide = transform_bounds(CRS, "EPSG:4326", *EXTENT)
    grey = np.broadcast_to(np.linspace(100.0, 900.0, 60, dtype=np.float32), (1, 30, 60))
    image = draped_image(write(tmp_path / "a.tif", grey, wide, "EPSG:4326"), EXTENT, CRS)
    assert (image[..., 0] == image[..., 2]).all()
    row = image[512, :, 0].astype(int)
    assert row[20] < 20
    assert row[-20] > 235
    assert (np.diff(row[100:-100]) >= 0).all()


def test_ground_beside_the_image_is_grey(tmp_path):
    west = (EXTENT[0], EXTENT[1], EXTENT[0] + 200.0, EXTENT[3])
    image = draped_image(write(tmp_path / "a.tif", np.full((3, 10, 10), 7, np.uint8), west), EXTENT, CRS)
    assert corners(image) == [(7, 7, 7), (200, 200, 200)] * 2


def test_an_image_that_cannot_be_used_is_refused(tmp_path):
    (tmp_path / "text.tif").write_text("no image")
    far = tuple(edge + 1e5 for edge in EXTENT)
    bands = np.ones((3, 4, 4), np.uint8)
    for path, words in (
        (tmp_path / "text.tif", "cannot be read"),
        (tmp_path / "none.tif", "cannot be read"),
        (write(tmp_path / "far.tif", bands, far), "does not touch"),
        (write(tmp_path / "bare.tif", bands, crs=None), "no coordinate system"),
    ):
        with pytest.raises(InputError, match=words):
            draped_image(path, EXTENT, CRS)

"""A small synthetic site: a slope of 30 degrees that runs out into a plain, and a slab that slides down it."""

import numpy as np

SITE = """\
name: ramp
title: Slab on a ramp
terrain:
  dem: inputs/dem.tif
release:
  - name: slab
    raster: inputs/thickness.tif
    placement: on_surface
material: {density: 2000, youngs_modulus: 2.0e+6, friction_angle_deg: 30}
basal_friction_angle_deg: 20
simulation: {cell_size: 10, particles_per_cell: 8, end_time: 20}
ensemble:
  members: 4
  seed: 1
  parameters:
    basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}
hazard: {thickness_thresholds: [0.1, 1], speed_thresholds: [1], pressure_thresholds: [3000], percentiles: [50]}
"""
CELL, ROWS, COLUMNS = 10.0, 24, 50
WEST, NORTH = 500_000.0, 5_000_000.0


def write_raster(path, values, crs="EPSG:32632"):
    import rasterio
    from rasterio.transform import from_origin

    rows, columns = values.shape
    profile = {"driver": "GTiff", "height": rows, "width": columns, "count": 1, "dtype": "float32", "nodata": -9999.0}
    with rasterio.open(path, "w", crs=crs, transform=from_origin(WEST, NORTH, CELL, CELL), **profile) as file:
        file.write(values.astype("float32"), 1)


def ramp():
    """Elevation (rows, columns) [m]: falls to the east, then flat."""
    easting = (np.arange(COLUMNS) + 0.5) * CELL
    return np.broadcast_to(np.maximum(0.0, (250.0 - easting) * np.tan(np.radians(30))), (ROWS, COLUMNS)).copy()


def slab():
    """Thickness (rows, columns) [m]: 8 m over 60 m by 60 m high on the slope."""
    thickness = np.zeros((ROWS, COLUMNS))
    thickness[9:15, 5:11] = 8.0
    return thickness


def write_site(folder, text=SITE, elevation=None, thickness=None):
    """Folder of the site, after writing site.yaml and inputs."""
    (folder / "inputs").mkdir(parents=True)
    write_raster(folder / "inputs" / "dem.tif", ramp() if elevation is None else elevation)
    write_raster(folder / "inputs" / "thickness.tif", slab() if thickness is None else thickness)
    (folder / "site.yaml").write_text(text)
    return folder


def member_file(folder, number):
    """File of a member of the site in its results folder."""
    from runout.config.site import read_site
    from runout.ensemble.member import plan_members

    return plan_members(read_site(folder))[number].file(folder / "results")

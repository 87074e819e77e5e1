"""Terrain: from an elevation raster on disk to a checked raster in metres, and to the surface that mass slides on.

Imports nothing heavy; rasterio, pyproj, xarray and scipy are loaded by the functions that need them.
"""

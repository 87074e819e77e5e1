"""Reads inputs and writes NetCDF, GeoTIFF, GeoPackage and provenance; a file is written completely or not at all."""

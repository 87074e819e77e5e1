"""Files: NetCDF, GeoTIFF, GeoPackage and provenance; every file is either whole or absent."""

"""Releases: reading polygons and thickness rasters, checking their volume, sampling particles.

``read`` makes a :class:`runout.model.release.Release`; ``polygons`` and ``crs`` check vector files, ``ground`` checks a
release against its terrain, ``volume`` against what was stated; ``taper`` shapes a mass that thins out to its
rim, ``outlets`` finds what is trapped in a scar; ``coverage`` holds the exact areas and the conservative
regridding; ``arrangement`` says how many particles a cell has by default, ``sample`` fills the release with them, at the heights of
``stagger``. Only ``read``, ``polygons`` and ``crs`` need GDAL.
"""

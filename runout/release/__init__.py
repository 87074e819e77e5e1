"""Releases: reads polygons and thickness rasters, checks their volume, samples particles.

``read`` makes a :class:`runout.model.release.Release` from polygons (:mod:`runout.io.polygons`), a raster (``raster``) or an array.
``ground`` checks it against its terrain, ``volume`` against the stated volume. ``taper`` shapes a mass that thins out to its
outline, and ``outlets`` finds mass that is trapped in a scar. ``arrangement`` sets the default number of particles per cell,
``sample`` fills the release with particles at the heights of ``arrangement``, and ``known`` moves them onto ground with elevations.
"""

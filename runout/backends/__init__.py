"""Backends store nodes and particles and run the loops; see :mod:`runout.backends.protocol`."""

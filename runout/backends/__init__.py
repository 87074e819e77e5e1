"""Backends decide where nodes live; see :mod:`runout.backends.protocol`."""

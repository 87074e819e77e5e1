"""Friction laws, one file each: parameters and resistance. :mod:`runout.model.friction_laws` finds them by their file names."""

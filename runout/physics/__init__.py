"""Every formula, once: plain scalar functions that numba and warp compile from the same source.

The functions import ``math`` and ``typing`` only. ``real`` and ``i64`` stand for the number types of the
binding (see :mod:`runout.backends.compile`); as plain Python they are ``float`` and ``int``.
"""

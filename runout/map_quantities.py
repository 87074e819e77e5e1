"""Names of :mod:`runout.quantities` under the path that backends and benchmarks import."""

from runout.quantities import QUANTITIES, member_map_names, peak_quantities

__all__ = ["QUANTITIES", "member_map_names", "peak_quantities"]

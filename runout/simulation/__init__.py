"""A run from its inputs to its result.

:mod:`runout.simulation.single` runs one scenario, :mod:`runout.simulation.batch` many of them on a GPU;
:mod:`runout.simulation.run` is the time loop of each.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runout.simulation.single import simulate

__all__ = ["simulate"]


def __getattr__(name: str) -> Any:
    if name != "simulate":
        raise AttributeError(f"module 'runout.simulation' has no attribute {name!r}")
    from runout.simulation.single import simulate

    return simulate

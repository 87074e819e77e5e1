"""Readers that classes of the model offer as constructors, such as ``Terrain.from_raster``, and that belong to layers above.

The model imports no layer above it: :mod:`runout` declares where each reader is, and its module is imported on the first call.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

_HOMES: dict[str, str] = {}


def declare_readers(homes: Mapping[str, str]) -> None:
    """Declare the ``module:function`` of each reader, by the constructor that offers it: ``Terrain.from_raster``."""
    _HOMES.update(homes)


def declared_readers() -> dict[str, str]:
    """``module:function`` of each reader, by the constructor that offers it."""
    return dict(_HOMES)


def reader(constructor: str) -> Callable[..., Any]:
    """The function behind a constructor, such as ``Terrain.from_raster``.

    Raises KeyError if no reader is declared under this name.
    """
    module, _, function = _HOMES[constructor].partition(":")
    return getattr(import_module(module), function)  # type: ignore[no-any-return]

"""Hides dask from xarray, which imports all of it with the first array, although no array here is one of dask's.

That takes time and memory in every process where dask is installed for clusters.
"""

import sys


def hide_dask() -> None:
    """Let imports of dask fail in this process, as where it is not installed; nothing changes if it is imported already."""
    sys.modules.setdefault("dask", None)  # type: ignore[arg-type]


def show_dask() -> None:
    """Let dask be imported again."""
    if "dask" in sys.modules and sys.modules["dask"] is None:
        del sys.modules["dask"]

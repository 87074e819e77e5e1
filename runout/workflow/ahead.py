"""Imports what the next stages need while worker processes compute members and this process waits."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module

PRODUCTS = (
    *("netCDF4", "xarray", "rasterio", "geopandas", "matplotlib.figure", "matplotlib.backends.backend_agg", "jinja2"),
    *("runout.hazard.products", "runout.report.html"),
)  # modules of the stages hazard and report


@contextmanager
def imported_meanwhile(modules: Sequence[str] = PRODUCTS) -> Iterator[None]:
    """Context in which a thread imports ``modules``; its end waits for the one that is being imported, and leaves out the rest."""
    ended = threading.Event()
    thread = threading.Thread(target=_import, args=(modules, ended), daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _import(modules: Sequence[str], ended: threading.Event) -> None:
    for name in modules:
        if ended.is_set():
            return
        with suppress(ImportError):  # the stage that needs it says so
            import_module(name)

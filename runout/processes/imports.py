"""Start of a process: imports that it leaves out or makes while it waits, and collections of garbage that it spares.

Each states the processor time that it saves, on one core.
"""

import gc
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module

COLLECT = 50_000, 20, 20  # thresholds of the garbage collector: imports and compilers make many objects and few cycles


def collect_rarely() -> None:
    """Look for garbage in cycles less often than Python does, which looks each time 700 objects are new.

    It saves 0.15 s of a process of 2 s that writes a report. A report of 500 members takes no more memory with it.
    """
    gc.set_threshold(*COLLECT)


def give_blas_one_thread() -> None:
    """Let linear algebra run in one thread unless the user chooses; call it before numpy is imported.

    Matrices have some hundred rows at most. Where other programs use the cores, threads wait for each other: six tests of sampling
    errors, on two cores that are both in use, take 14 s of processor time with one thread and 59 s with two.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def hide_dask() -> None:
    """Let imports of dask fail in this process, as where it is not installed; nothing changes if it is imported already.

    xarray imports all of dask with its first array, although no array here is one of dask's. Where dask is installed for clusters,
    this saves 0.5 s in each process: in the command and in each worker.
    """
    sys.modules.setdefault("dask", None)  # type: ignore[arg-type]


def show_dask() -> None:
    """Let dask be imported again."""
    if "dask" in sys.modules and sys.modules["dask"] is None:
        del sys.modules["dask"]


@contextmanager
def imported_meanwhile(modules: Sequence[str]) -> Iterator[None]:
    """Context in which a thread imports ``modules``; its end waits for the one that is being imported, and leaves out the rest.

    While worker processes compute members, the command imports what makes its products: it takes 1.3 s, for which nobody waits.
    """
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

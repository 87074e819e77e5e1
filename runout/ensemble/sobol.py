"""Scrambled Sobol points, kept in the cache folder: to import the part of scipy that makes them takes longer than to read them."""

from contextlib import suppress

import numpy as np

from runout.errors import StorageError
from runout.io.atomic import read_json, write_json
from runout.io.provenance import checksum
from runout.processes.caches import compiled_code

SOBOL_BITS = 30  # points are multiples of 2**-30
MOST_KEPT = 2**16  # numbers in a file of the cache


def sobol_points(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Scrambled Sobol points (count, dimensions), strictly between 0 and 1; more points keep the first ones."""
    if dimensions == 0:
        return np.empty((count, 0))
    whole = (count - 1).bit_length()  # scipy warns unless the number is a power of two; the first points are the same
    points = (_kept if dimensions * 2**whole <= MOST_KEPT else _made)(whole, dimensions, seed)[:count]
    return points + 0.5**SOBOL_BITS / 2  # 0 would give an infinite quantile of a normal distribution


def _made(whole: int, dimensions: int, seed: int) -> np.ndarray:
    """The first 2**whole points."""
    from scipy.stats import qmc

    return qmc.Sobol(dimensions, scramble=True, bits=SOBOL_BITS, seed=seed).random_base2(whole)  # type: ignore[no-any-return]


def _kept(whole: int, dimensions: int, seed: int) -> np.ndarray:
    """:func:`_made`, from the cache if a whole file there holds them; one that cannot be written is not missed."""
    import scipy

    key = checksum([scipy.__version__, np.__version__, SOBOL_BITS, whole, dimensions, seed])
    path = compiled_code().folder / f"sobol-{key[:16]}.json"
    found = read_json(path)
    if found.get("key") == key and found.get("checksum") == checksum(found.get("points")):
        return np.array(found["points"])
    points = _made(whole, dimensions, seed)
    with suppress(StorageError, OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json({"key": key, "checksum": checksum(points.tolist()), "points": points.tolist()}, path)
    return points

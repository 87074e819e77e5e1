"""A listener that answers nobody: whoever is contacted shows; and a site whose inputs can be replaced."""

import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest


class Listener:
    """A port of this machine that accepts no connection; whether one was tried."""

    def __init__(self) -> None:
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.url = f"http://127.0.0.1:{self.socket.getsockname()[1]}"

    def was_contacted(self) -> bool:
        try:
            self.socket.accept()[0].close()
        except BlockingIOError:
            return False
        return True


@pytest.fixture
def listener(monkeypatch) -> Iterator[Listener]:
    """The listener; whoever contacts it gives up soon."""
    for name, value in {"GDAL_HTTP_TIMEOUT": "2", "GDAL_HTTP_CONNECTTIMEOUT": "2", "no_proxy": "127.0.0.1"}.items():
        monkeypatch.setenv(name, value)
    found = Listener()
    yield found
    found.socket.close()


@pytest.fixture
def raster() -> Callable[..., Path]:
    """Writer of a GeoTIFF of a slope: path, cells along a side."""
    import rasterio
    from rasterio.transform import from_origin

    def write(path: Path, side: int = 20, **tags: str) -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        values = np.add.outer(np.arange(side), np.arange(side)).astype("float32")
        shape = {"driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": "float32"}
        with rasterio.open(path, "w", crs="EPSG:32632", transform=from_origin(500_000, 5_000_200, 10, 10), **shape) as file:
            file.write(values, 1)
            if tags:
                file.update_tags(ns="OVERVIEWS", **tags)
        return path

    return write

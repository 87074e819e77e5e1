"""Writes the plugin of QGIS as one zip, from the files of :mod:`runout.qgis_plugin`."""

from importlib.resources import files
from pathlib import Path

from runout import __version__
from runout.hazard.archives import write_archive

FOLDER = "runout_qgis"  # of the plugin in QGIS; ``runout`` would hide the package
NAMES = ("__init__.py", "algorithms.py", "command.py", "layers.py", "provider.py", "metadata.txt", "icon.svg")
VERSION = "version=0\n"


def write_plugin(path: Path | None = None) -> Path:
    """Path of the zip that "Install from ZIP" of QGIS takes; equal versions give equal files.

    Parameters
    ----------
    path : Path, optional
        File to write. Default: ``runout_qgis_VERSION.zip`` in the working folder.

    Raises
    ------
    StorageError
        If it cannot be written.
    """
    target = path or Path(f"{FOLDER}_{__version__}.zip")
    source = files("runout.qgis_plugin")
    contents = {name: source.joinpath(name).read_text(encoding="utf-8") for name in NAMES}
    contents["metadata.txt"] = contents["metadata.txt"].replace(VERSION, f"version={__version__}\n")
    return write_archive(target, {f"{FOLDER}/{name}": text.encode() for name, text in contents.items()})

"""Writes the plugin of QGIS as one zip, from the files of :mod:`runout.qgis_plugin`."""

import zipfile
from importlib.resources import files
from pathlib import Path

from runout import __version__
from runout.io.atomic import whole_file

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
    with whole_file(target) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in NAMES:
            text = source.joinpath(name).read_text(encoding="utf-8")
            if name == "metadata.txt":
                text = text.replace(VERSION, f"version={__version__}\n")
            archive.writestr(zipfile.ZipInfo(f"{FOLDER}/{name}"), text, zipfile.ZIP_DEFLATED)
    return target

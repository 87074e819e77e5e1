"""OpenGL in software (OSMesa) of the extra ``software-gl``, for a machine without a driver or display.

VTK tries a display, then EGL, then OSMesa; it searches OSMesa as ``libOSMesa.so.8`` on the library path. The wheel
``lavavu-osmesa`` holds that library under another name, so that the process that draws gets a link to it.
"""

import os
import sys
from importlib import metadata
from pathlib import Path

DISTRIBUTION = "lavavu-osmesa"
LIBRARIES = "lavavu_osmesa.libs"  # folder of the wheel
NAME = "libOSMesa.so.8"  # that VTK opens
PATH = "LD_LIBRARY_PATH"
INSTALL = "pip install 'runout[software-gl]'"


def library() -> Path | None:
    """OSMesa of the extra, or None where it is not installed."""
    if sys.platform != "linux":
        return None
    try:
        folder = Path(str(metadata.distribution(DISTRIBUTION).locate_file(LIBRARIES)))
    except metadata.PackageNotFoundError:
        return None
    return next(iter(sorted(folder.glob("libOSMesa*.so*"))), None)


def environment(folder: Path) -> dict[str, str]:
    """Variables with which a new process finds OSMesa; empty without the extra.

    Parameters
    ----------
    folder : Path
        Gets the link to the library; it exists as long as the process draws.
    """
    osmesa = library()
    if osmesa is None:
        return {}
    (folder / NAME).symlink_to(osmesa)
    before = os.environ.get(PATH)  # a library that the user chose comes first
    return {PATH: os.pathsep.join([*([before] if before else []), str(folder), str(osmesa.parent)])}

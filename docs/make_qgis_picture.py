"""Make the picture of the layout for print in QGIS: ``python docs/make_qgis_picture.py RESULTS``.

``RUNOUT_QGIS_PYTHON`` names a Python that has QGIS; default: ``/usr/bin/python3``.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
PICTURE = HERE / "images" / "qgis_layout.png"
SCRIPT = HERE.parent / "tests" / "hazard" / "open_in_qgis.py"
COLOURS = 128  # of the picture, so that it stays small


def draw(results: Path) -> None:
    """Write the layout of the project in a results folder to :data:`PICTURE`."""
    (project,) = results.glob("*.qgz")
    own = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "PROJ_", "GDAL_"))}
    with tempfile.TemporaryDirectory() as folder:
        python = os.environ.get("RUNOUT_QGIS_PYTHON", "/usr/bin/python3")
        subprocess.run([python, str(SCRIPT), str(project), folder], check=True, env=own)
        with Image.open(Path(folder) / "layout.png") as image:
            image.convert("RGB").quantize(COLOURS).save(PICTURE, optimize=True)
    print(f"wrote {PICTURE}")


if __name__ == "__main__":
    draw(Path(sys.argv[1]))

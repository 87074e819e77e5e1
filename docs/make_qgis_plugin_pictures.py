"""Draws the pictures of docs/guide/qgis.md: the dialog of an algorithm, and results as layers. The Python of QGIS runs it.

``python3 docs/make_qgis_plugin_pictures.py SITE ZIP FOLDER`` opens the results of a site, without a display; ZIP is that of
``runout qgis-plugin``, FOLDER gets the pictures.
"""

import os
import sys
import tempfile
import zipfile
from pathlib import Path
from unittest.mock import MagicMock

SITE, ARCHIVE, PICTURES = map(Path, sys.argv[1:])
PROFILE = Path(tempfile.mkdtemp())
os.environ |= {"QT_QPA_PLATFORM": "offscreen", "QGIS_CUSTOM_CONFIG_PATH": str(PROFILE), "XDG_CONFIG_HOME": str(PROFILE)}
for place in ("/usr/share/qgis/python/plugins", "/usr/share/qgis/python", str(PROFILE)):
    sys.path.insert(0, place)
with zipfile.ZipFile(ARCHIVE) as archive:
    archive.extractall(PROFILE)

from qgis import core, gui, utils  # noqa: E402
from qgis.PyQt.QtWidgets import QApplication, QHBoxLayout, QWidget  # noqa: E402

application = core.QgsApplication([], True)
application.initQgis()

import runout_qgis  # noqa: E402
from processing.core.Processing import Processing  # noqa: E402

utils.iface = MagicMock()  # the window of QGIS; the modules above work without one

from processing.gui.AlgorithmDialog import AlgorithmDialog  # noqa: E402
from runout_qgis.layers import add_results  # noqa: E402

Processing.initialize()
plugin = runout_qgis.classFactory(None)
plugin.initProcessing()
project = core.QgsProject.instance()


def dialog(name: str, width: int, height: int, **values: object) -> None:
    """Draw the dialog of an algorithm with some values."""
    algorithm = application.processingRegistry().createAlgorithmById(f"runout:{name}")
    made = AlgorithmDialog(algorithm, False, None)
    made.setParameters(values)
    made.resize(width, height)
    made.show()
    QApplication.processEvents()
    made.grab().save(str(PICTURES / f"qgis_{name}.png"))
    made.hide()


def results() -> None:
    """Draw the layers that the results are opened as, beside the map."""
    add_results(SITE / "results", f"runout {SITE.name}", project)
    window, canvas = QWidget(), gui.QgsMapCanvas()
    tree, model = gui.QgsLayerTreeView(), core.QgsLayerTreeModel(project.layerTreeRoot())
    tree.setModel(model)
    tree.setMaximumWidth(430)
    row = QHBoxLayout(window)
    row.setContentsMargins(0, 0, 0, 0)
    row.addWidget(tree)
    row.addWidget(canvas)
    bridge = gui.QgsLayerTreeMapCanvasBridge(project.layerTreeRoot(), canvas)
    bridge.setCanvasLayers()
    window.resize(1100, 640)
    window.show()
    canvas.setExtent(canvas.fullExtent())
    for layer in project.mapLayers().values():
        if "inundation" in layer.name() and isinstance(layer, core.QgsVectorLayer):
            around = layer.extent()
            around.scale(2.0)
            canvas.setDestinationCrs(layer.crs())
            canvas.setExtent(around)
    canvas.refreshAllLayers()
    for _ in range(3):
        QApplication.processEvents()
        canvas.waitWhileRendering()
    window.grab().save(str(PICTURES / "qgis_results.png"))


PICTURES.mkdir(parents=True, exist_ok=True)
results()
dem = core.QgsRasterLayer(str(next(SITE.rglob("elevation.tif"))), "elevation")
release = core.QgsVectorLayer(f"{SITE / 'results' / 'outlines.gpkg'}|layername=release", "release", "ogr")
project.addMapLayers([dem, release])
dialog("new", 900, 620, DEM=dem, RELEASE=release, PROCESS="rock_avalanche", THICKNESS=35.0, SITE="sites/slope")
sys.stdout.flush()
os._exit(0)  # QGIS may crash when the interpreter frees its objects

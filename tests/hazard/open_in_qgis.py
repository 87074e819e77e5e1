"""Opens a project in QGIS without a window and prints as JSON what it shows; run by the Python that has QGIS.

    /usr/bin/python3 open_in_qgis.py SITE.qgz OUT

``OUT`` gets ``view.png`` (the first view), ``arrival_N.png`` (the arrival up to three moments), ``layout.pdf`` and ``layout.png``.
"""

import json
import os
import sys

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
from qgis.core import (
    QgsApplication,
    QgsDateTimeRange,
    QgsLayoutExporter,
    QgsLayoutItemMap,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsProject,
    QgsUnitTypes,
)
from qgis.PyQt.QtCore import QSize


def drawn(project, layers, path, when=None):
    """Draw layers over the first view of a project; number of pixels that are not white."""
    settings = QgsMapSettings()
    settings.setLayers(layers)
    settings.setDestinationCrs(project.crs())
    settings.setExtent(project.viewSettings().defaultViewExtent())
    settings.setOutputSize(QSize(1100, 800))
    if when is not None:
        settings.setIsTemporal(True)
        settings.setTemporalRange(when)
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    image = job.renderedImage()
    image.save(path)
    return sum(image.pixel(x, y) & 0xFFFFFF != 0xFFFFFF for x in range(0, 1100, 4) for y in range(0, 800, 4))


def played(project, out):
    """Pixels of the arrival at parts of its time."""
    layer = next((one for one in project.mapLayers().values() if one.temporalProperties().isActive()), None)
    if layer is None:
        return []
    span = project.timeSettings().temporalRange()
    length = span.begin().secsTo(span.end())
    moments = [span.begin().addSecs(int(part * length / 100)) for part in (5, 50, 100)]
    return [drawn(project, [layer], f"{out}/arrival_{k}.png", QgsDateTimeRange(span.begin(), end)) for k, end in enumerate(moments)]


def described(project, out):
    """What a project shows."""
    tree = project.layerTreeRoot()
    visible = [node.layer() for node in tree.findLayers() if node.isVisible()]
    layouts = project.layoutManager().layouts()
    for layout in layouts:
        exporter = QgsLayoutExporter(layout)
        assert exporter.exportToPdf(f"{out}/layout.pdf", QgsLayoutExporter.PdfExportSettings()) == QgsLayoutExporter.Success
        image = QgsLayoutExporter.ImageExportSettings()
        image.dpi = 110
        assert exporter.exportToImage(f"{out}/layout.png", image) == QgsLayoutExporter.Success
    return {
        "title": project.title(),
        "crs": project.crs().authid() or project.crs().description(),
        "crs_valid": project.crs().isValid(),
        "invalid": [one.name() for one in project.mapLayers().values() if not one.isValid()],
        "groups": {group.name(): [node.name() for node in group.findLayers()] for group in tree.findGroups()},
        "visible": [layer.name() for layer in visible],
        "styles": {layer.id(): layer.renderer().type() for layer in project.mapLayers().values()},
        "layer_crs": sorted({layer.crs().authid() for layer in project.mapLayers().values()}),
        "labels": {layer.id(): layer.labelsEnabled() for layer in project.mapLayers().values() if hasattr(layer, "labelsEnabled")},
        "pixels": drawn(project, visible, f"{out}/view.png"),
        "arrival": played(project, out),
        "step": [project.timeSettings().timeStep(), QgsUnitTypes.toString(project.timeSettings().timeStepUnit())],
        "layouts": {
            layout.name(): sorted(type(item).__name__ for item in layout.items() if type(item).__name__.startswith("QgsLayoutItem"))
            for layout in layouts
        },
        "map_scales": [item.scale() for layout in layouts for item in layout.items() if isinstance(item, QgsLayoutItemMap)],
    }


def main(path, out):
    """Open the project and print what it shows."""
    application = QgsApplication([], False)
    application.initQgis()
    project = QgsProject.instance()
    read = project.read(path)
    print(json.dumps({"read": read, "error": project.error()} | described(project, out)))
    sys.stdout.flush()
    os._exit(0)  # the clean-up of QGIS 3.22 may crash without a window


if __name__ == "__main__":
    main(*sys.argv[1:])

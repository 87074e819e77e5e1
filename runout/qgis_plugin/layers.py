"""Layers of QGIS as files for the command, and results of a site as layers of a project."""

from __future__ import annotations

import re
from pathlib import Path

from qgis import core

SHOWN = ("inundation_probability", "inundation")  # the layers that are visible at first; the others are a click away


def exported(source: core.QgsProcessingFeatureSource, path: Path, context: core.QgsProcessingContext) -> Path:
    """A GeoPackage with the features of a layer as QGIS shows them: edits that are not saved, a filter, a selection."""
    path.parent.mkdir(parents=True, exist_ok=True)
    layer = source.materialize(core.QgsFeatureRequest())
    options = core.QgsVectorFileWriter.SaveVectorOptions()
    options.driverName, options.layerName = "GPKG", path.stem
    options.attributes = [k for k, field in enumerate(layer.fields()) if field.name() != "fid"]  # a GeoPackage makes its own
    written = core.QgsVectorFileWriter.writeAsVectorFormatV3(layer, str(path), context.transformContext(), options)
    if written[0]:
        raise core.QgsProcessingException(f"{path}: cannot be written ({written[1]})")
    return path


def raster_file(layer: core.QgsRasterLayer, folder: Path, context: core.QgsProcessingContext) -> str:
    """Name of the file of a raster layer; a layer that is no file is written to a GeoTIFF in a folder."""
    path = core.QgsProviderRegistry.instance().decodeUri(layer.providerType(), layer.source()).get("path") or ""
    if layer.providerType() == "gdal" and Path(path).exists():
        return layer.source()
    pipe, provider = core.QgsRasterPipe(), layer.dataProvider()
    if not pipe.set(provider.clone()):
        raise core.QgsProcessingException(f"{layer.name()}: cannot be read as a raster")
    target = folder / "dem.tif"
    fault = core.QgsRasterFileWriter(str(target)).writeRaster(
        pipe, provider.xSize(), provider.ySize(), provider.extent(), provider.crs(), context.transformContext()
    )
    if fault:
        raise core.QgsProcessingException(f"{layer.name()}: cannot be written to a GeoTIFF (error {fault})")
    return str(target)


def add_results(results: Path, title: str, project: core.QgsProject) -> list[str]:
    """Add the results of a site to a project as one group: that of the project file of the site, else rasters and outlines.

    Returns the names of the layers; QgsProcessingException if there is nothing to add.
    """
    made = sorted(results.glob("*.qgz"))
    rasters = sorted(results.rglob("*.tif"))
    if not made and not rasters:
        raise core.QgsProcessingException(f"{results}: holds no maps; run the site first")
    group = project.layerTreeRoot().insertGroup(0, title)
    if made:
        other = core.QgsProject()
        if not other.read(str(made[0])):
            raise core.QgsProcessingException(f"{made[0]}: cannot be read ({other.error()}); `runout hazard` writes it again")
        return _copied(other.layerTreeRoot(), group, project)
    names = []
    for outlines in sorted(results.glob("*.gpkg")):
        for part in core.QgsProviderRegistry.instance().querySublayers(str(outlines)):
            names += _added(core.QgsVectorLayer(part.uri(), part.name(), "ogr"), group, project)
    for path in rasters:  # a QML file beside it is its style
        names += _added(core.QgsRasterLayer(str(path), path.stem), group, project)
    return names


def _added(layer: core.QgsMapLayer, group: core.QgsLayerTreeGroup, project: core.QgsProject) -> list[str]:
    """Add a layer to a group; its name, or nothing if it cannot be read."""
    if not layer.isValid():
        return []
    project.addMapLayer(layer, False)
    node = group.addLayer(layer)
    node.setItemVisibilityChecked(layer.name() in SHOWN)
    node.setExpanded(layer.name() in SHOWN)
    return [layer.name()]


def _copied(source: core.QgsLayerTreeGroup, group: core.QgsLayerTreeGroup, project: core.QgsProject) -> list[str]:
    """Add all layers of a group of another project with their styles, groups and visibility."""
    names = []
    for child in source.children():
        if core.QgsLayerTree.isGroup(child):
            node = group.addGroup(child.name())
            names += _copied(child, node, project)
        elif child.layer() is not None and child.layer().isValid():
            layer = child.layer().clone()
            project.addMapLayer(layer, False)
            node = group.addLayer(layer)
            names.append(layer.name())
        else:
            continue
        node.setItemVisibilityChecked(child.itemVisibilityChecked())
        node.setExpanded(child.isExpanded())
    return names


def file_name(text: str) -> str:
    """A text as the name of a file."""
    return re.sub(r"[^\w-]+", "_", text).strip("_") or "layer"

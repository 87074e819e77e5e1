"""Texts of files that name other files and addresses."""

from typing import Any

SQUARE = [[[40, 40], [80, 40], [80, 80], [40, 80], [40, 40]]]


def vrt(source: str, relative: int = 0, band: str = "", inner: str = "", dataset: str = "", more: str = "") -> str:
    """Text of a virtual raster of one source."""
    return (
        f'<VRTDataset rasterXSize="20" rasterYSize="20"{dataset}><SRS>EPSG:32632</SRS>'
        f"<GeoTransform>500000, 10, 0, 5000200, 0, -10</GeoTransform>{more}"
        f'<VRTRasterBand dataType="Float32" band="1"{band}>{inner}<SimpleSource>'
        f'<SourceFilename relativeToVRT="{relative}">{source}</SourceFilename><SourceBand>1</SourceBand></SimpleSource>'
        "</VRTRasterBand></VRTDataset>"
    )


def geojson(**more: Any) -> dict[str, Any]:
    """A GeoJSON of one square."""
    square = {"type": "Feature", "properties": {"depth": 4.0}, "geometry": {"type": "Polygon", "coordinates": SQUARE}}
    return {"type": "FeatureCollection", "features": [square], **more}

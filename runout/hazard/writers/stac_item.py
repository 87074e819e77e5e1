"""``stac.json``: an item for a catalogue of maps (SpatioTemporal Asset Catalog), with the main maps, hazard.nc and the outlines."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from runout.hazard.maps import map_layers
from runout.hazard.style import legend_unit
from runout.hazard.writers import Products
from runout.io.atomic import write_json
from runout.io.grid import horizontal_crs
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import pyproj
    import pystac

NAME = "stac.json"
EXTENSIONS = ["https://stac-extensions.github.io/projection/v2.0.0/schema.json"]
COG, NETCDF, GEOPACKAGE = (
    "image/tiff; application=geotiff; profile=cloud-optimized",
    "application/netcdf",
    "application/geopackage+sqlite3",
)


def write(products: Products) -> list[Path]:
    """Path of the item; none for local coordinates, which have no place on the globe."""
    if products.terrain.crs is None:
        return []
    return [write_json(item(products).to_dict(include_self_link=False), products.results / NAME)]


def earlier(results: Path) -> set[Path]:
    """The item of an earlier run."""
    return {path for path in [results / NAME] if path.is_file()}


def item(products: Products) -> "pystac.Item":
    """The item: footprint of the raster in longitude and latitude, and what the maps suppose."""
    import pystac
    import shapely

    attrs = products.hazard.attrs
    box = [float(attrs[f"geospatial_{edge}"]) for edge in ("lon_min", "lat_min", "lon_max", "lat_max")]
    described = pystac.Item(
        str(attrs["id"]),
        shapely.geometry.mapping(shapely.box(*box)),
        box,
        datetime.fromisoformat(str(attrs.get("date_created"))).astimezone(UTC),
        {
            "title": str(attrs["title"]),
            "description": str(attrs["summary"]),
            "software": str(attrs["source"]),
            "proj:code": _code(horizontal_crs(str(products.terrain.crs))),
            "ensemble": str(attrs["ensemble"]),
        },
        stac_extensions=EXTENSIONS,
    )
    for name, asset in _assets(products).items():
        described.add_asset(name, asset)
    return described


def _assets(products: Products) -> "dict[str, pystac.Asset]":
    from pystac import Asset

    maps = {}
    for layer in map_layers(products.hazard):
        if layer.path.count("/") == 1:
            unit = legend_unit(VARIABLES[layer.name].printed[0]).strip()
            fields = {"bands": [{"name": layer.name, "unit": unit} if unit else {"name": layer.name}]}
            maps[layer.stem] = Asset(f"./{layer.path}.tif", layer.title, media_type=COG, roles=["data"], extra_fields=fields)
    return {
        "hazard": Asset("./hazard.nc", "All hazard maps", media_type=NETCDF, roles=["data"]),
        **maps,
        "outlines": Asset("./outlines.gpkg", "Outlines, releases and structures", media_type=GEOPACKAGE, roles=["data"]),
        "origin": Asset("./run.json", "Inputs, settings and versions", media_type="application/json", roles=["metadata"]),
    }


def _code(crs: "pyproj.CRS") -> str | None:
    """Authority and number of a coordinate system; None for one that has none."""
    authority = crs.to_authority()
    return ":".join(authority) if authority else None

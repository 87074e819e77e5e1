"""``outlines.gpkg``: releases, areas of equal probability, structures, probes and observations as vector layers with styles."""

from pathlib import Path

from runout.hazard.observed import observed_layers
from runout.hazard.outline_style import outline_styles
from runout.hazard.probe_layers import probe_layers
from runout.hazard.writers import Products
from runout.io.vector import write_outlines


def write(products: Products) -> list[Path]:
    """Path of the file."""
    site, terrain, hazard, observed = products.site, products.terrain, products.hazard, products.observed
    path = write_outlines(
        products.results / "outlines.gpkg",
        terrain,
        products.releases,
        hazard["inundation_probability"].values,
        attributes={"thickness_threshold_m": float(hazard["thickness_threshold"].values[0])} | products.ensemble.counts(),
        zones=site.files.zones(),
        obstacles=[part for obstacles in site.files.obstacles() for part in obstacles.parts],
        styles=outline_styles(),
        further={**(observed_layers(observed) if observed else {}), **products.built.layers, **probe_layers(site.files.probes())},
    )
    return [path]

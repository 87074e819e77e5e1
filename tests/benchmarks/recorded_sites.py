"""Example sites as the recorded studies have them."""

from dataclasses import replace
from pathlib import Path

from runout.config.site import Site, read_site


def with_vertical_edges(path: Path) -> Site:
    """A site whose polygons have the stated thickness up to their outline, whatever its site.yaml says of the edge."""
    site = read_site(path)
    releases = [r.model_copy(update={"edge": "vertical"}) if r.polygons else r for r in site.settings.release]
    return replace(site, settings=site.settings.model_copy(update={"release": releases}))

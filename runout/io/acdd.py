"""Global attributes of the conventions ACDD 1.3; unknown ones are left out."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from runout.model.terrain import Terrain

STANDARD_NAMES = "CF Standard Name Table v93"
_NAMES = {  # keys of `metadata` in site.yaml -> attributes
    "author": "creator_name",
    "email": "creator_email",
    "url": "creator_url",
    "institution": "institution",
    "project": "project",
    "purpose": "purpose",
    "license": "license",
    "references": "references",
    "acknowledgement": "acknowledgement",
}


def study_attributes(stated: Mapping[str, Any]) -> dict[str, str]:
    """Attributes of author and purpose, from the block ``metadata`` of a site.yaml."""
    found = {attribute: str(stated[key]) for key, attribute in _NAMES.items() if stated.get(key)}
    if "creator_name" in found:
        found["creator_type"] = "person"
        found |= {"creator_institution": found["institution"]} if "institution" in found else {}
    elif "institution" in found:
        found |= {"creator_name": found["institution"], "creator_type": "institution"}
    return found


def vertical_attributes(terrain: Terrain) -> dict[str, Any]:
    """Range of the known elevations [m]."""
    return {
        "geospatial_vertical_min": float(np.nanmin(terrain.elevation)),
        "geospatial_vertical_max": float(np.nanmax(terrain.elevation)),
        "geospatial_vertical_units": "m",
        "geospatial_vertical_positive": "up",
    }

"""What the inputs of a site hold, read once for many members."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from runout.model.friction import FrictionZones
    from runout.model.probes import Probes
    from runout.model.release import Release
    from runout.model.structures import Structures
    from runout.model.terrain import Terrain


@dataclass(frozen=True)
class SiteData:
    """Inputs that all members share: terrain, releases with a volume factor of 1, friction zones, structures, probes."""

    terrain: "Terrain"
    releases: "tuple[Release, ...]"
    friction_zones: "FrictionZones | None"
    structures: "Structures | None" = None
    probes: "Probes | None" = None

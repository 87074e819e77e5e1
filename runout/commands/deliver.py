"""Command that writes the layers of the Swiss data model of hazard mapping."""

import logging
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from runout.commands.options import Injected, command
from runout.errors import ExitCode

LOGGER = logging.getLogger(__name__)


@command(writes=False)
def deliver(
    product: Annotated[Path, Parameter(help="A site, its results, or its hazard.nc, with intensity classes of a Swiss scheme.")],
    *,
    canton: Annotated[str, Parameter(help="Two letters of the canton that is responsible for the data, such as VS.")],
    process: Annotated[str, Parameter(help="Process of the model, such as w_debris_flow or r_rock_slide_rock_avalanche.")],
    source: Annotated[str, Parameter(help="Name of the source of the process, such as that of the torrent.")],
    term: Annotated[str, Parameter(help="Word of the canton for the process [default: that of the model].")] = "",
    session: Injected,
) -> int:
    """Write hazard_mapping_166_1.gpkg, layers of the Swiss data model of hazard mapping, beside hazard.nc or to --out FOLDER."""
    from runout.hazard.merging import product_of, read_product
    from runout.hazard.swiss_delivery import NAME, Delivery, write_delivery
    from runout.io.places import require_place

    path, delivery = product_of(product), Delivery(canton, process, source, term)
    folder = session.out or path.parent
    require_place("--out", folder, folder=True)
    LOGGER.info("wrote %s", write_delivery(read_product(path), delivery, folder / NAME))
    return ExitCode.OK

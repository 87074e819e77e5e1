"""Cases of the validation: runs beside published tools, experiments and observed events."""

from runout.studies.validation_cases import (
    avakot,
    cascades_2021,
    cascades_2021_fit,
    columns,
    flume,
    frank_slide,
    iseesnow,
    maipo,
)
from runout.studies.validation_cases.case import ValidationCase

CASES: dict[str, ValidationCase] = {
    case.name: case
    for case in (
        iseesnow.COULOMB_ONLY,
        iseesnow.IDEALIZED_TOPO,
        ValidationCase("frank_slide", "Frank Slide beside SHALTOP, frame by frame", frank_slide.measure),
        ValidationCase("cascades_2021", "Cascades 2021 beside the DEM of difference", cascades_2021.measure),
        ValidationCase("cascades_2021_fit", "Cascades 2021 fitted on half of the reaches", cascades_2021_fit.measure),
        ValidationCase("maipo", "Six debris flows of the upper Maipo, each from the other five", maipo.measure),
        ValidationCase("avakot", "AvaFrame's avaKot with its own friction, beside com1DFA", avakot.measure),
        ValidationCase("flume", "Gate releases at the USGS debris-flow flume", flume.measure),
        ValidationCase("columns", "Columns of rods and of sand beside experiments", columns.measure),
    )
}

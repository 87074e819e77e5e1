"""Cases of the validation: runs beside published tools, experiments and observed events."""

from runout.studies.validation_cases import cascades_2021, columns, flume, frank_slide, iseesnow
from runout.studies.validation_cases.case import ValidationCase

CASES: dict[str, ValidationCase] = {
    case.name: case
    for case in (
        iseesnow.COULOMB_ONLY,
        iseesnow.IDEALIZED_TOPO,
        ValidationCase("frank_slide", "Frank Slide beside SHALTOP, frame by frame", frank_slide.measure),
        ValidationCase("cascades_2021", "Cascades 2021 beside the DEM of difference", cascades_2021.measure),
        ValidationCase("flume", "Gate releases at the USGS debris-flow flume", flume.measure),
        ValidationCase("columns", "Columns of rods and of sand beside experiments", columns.measure),
    )
}

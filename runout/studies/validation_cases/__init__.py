"""Cases of the validation: runs beside published tools, experiments and observed events."""

from runout.studies.validation_cases import frank_slide, frank_slide_page, iseesnow_cases
from runout.studies.validation_cases.case import ValidationCase

CASES: dict[str, ValidationCase] = {
    case.name: case
    for case in (
        iseesnow_cases.COULOMB_ONLY,
        iseesnow_cases.IDEALIZED_TOPO,
        ValidationCase("frank_slide", "Frank Slide beside SHALTOP, frame by frame", frank_slide.measure, frank_slide_page.page),
    )
}

"""The two cases of ISeeSnow: the runs of each."""

from runout.studies.validation_cases.case import ValidationCase
from runout.studies.validation_cases.iseesnow import Variant, measure
from runout.studies.validation_cases.iseesnow_surge import measure_surges

LEVELLED = (2, 2, 12)  # particles per cell: at 5 m four levels through the slab, as by default
ONE_LEVEL = (2, 2, 4)
COARSE = (Variant(10.0, (2, 2, 24)),)
COULOMB_FULL = (
    Variant(5.0, LEVELLED),
    Variant(5.0, LEVELLED, polygon=True),
    Variant(5.0, LEVELLED, polygon=True, same_mass=True),
    Variant(5.0, ONE_LEVEL),
    Variant((5.0, 5.0, 2.5)),
    Variant(2.5),
    Variant(10.0, (2, 2, 24)),
    Variant(10.0, ONE_LEVEL),
)
TOPO_FULL = (
    Variant(5.0, LEVELLED, drag="column"),
    Variant(5.0, LEVELLED, polygon=True, drag="column"),
    Variant(5.0, LEVELLED, 40.0, drag="column"),
    Variant(10.0, (2, 2, 24), drag="column"),
    Variant(5.0, LEVELLED, drag="base"),
    Variant(5.0, LEVELLED, 43.0, drag="base"),
)
TOPO_COARSE = (Variant(10.0, (2, 2, 24), drag="column"),)
SURGES = (
    Variant(5.0, LEVELLED, drag="column"),
    Variant(10 / 3, (2, 2, 8), drag="column"),
    Variant((5.0, 5.0, 2.5), (2, 2, 6), drag="column"),
    Variant(5.0, LEVELLED, 24.0, drag="column"),
)

COULOMB_ONLY = ValidationCase(
    "coulomb_only",
    "ISeeSnow CoulombOnly: a slab with Coulomb friction beside 13 tools",
    lambda full: measure("CoulombOnly", COULOMB_FULL if full else COARSE),
)
IDEALIZED_TOPO = ValidationCase(
    "idealized_topo",
    "ISeeSnow IdealizedTopo: a slab with Voellmy friction beside 12 tools",
    lambda full: measure("IdealizedTopo", TOPO_FULL) | measure_surges(SURGES) if full else measure("IdealizedTopo", TOPO_COARSE),
)

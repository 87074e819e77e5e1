"""Valid ranges of the soil of slopes that may fail, in site.yaml and in options."""

from runout.model.limits import Range

MOST_SAMPLES = 4096
RANGES = {
    "cohesion": Range(0, 1e6, "Pa"),
    "friction_angle": Range(1, 60, "deg", degrees=True),
    "soil_thickness": Range(0.01, 100, "m", "thickness is vertical, in metres"),
    "saturation": Range(0, 1, "", "1 is water up to the surface"),
    "transmissivity_recharge": Range(1, 1e6, "m", "transmissivity over recharge"),
    "soil_density": Range(1000, 4000, "kg m-3"),
}

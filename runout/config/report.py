"""Settings of the report."""

from typing import Literal

from runout.config.distributions import Settings, quantity


class ReportSettings(Settings):
    """What the report shows besides maps and tables."""

    stills: Literal["none", "worst", "all"] = quantity(
        "3D pictures of the maximum thickness: none, of the member with the longest runout (worst), or of every member (all); they "
        "need the extra runout[view] and OpenGL, and take about two seconds each",
        "none",
    )


REPORT = quantity("what the report shows besides maps and tables: stills none, worst or all", None, examples=[{"stills": "worst"}])

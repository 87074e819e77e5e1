"""Draws members in three dimensions for the report; a failure leaves a sentence and nothing else."""

import logging
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any

from runout.errors import RenderError
from runout.report.relief import address
from runout.view import process
from runout.view.camera import best_direction
from runout.view.film import maximum_scene, paletted
from runout.view.surfaces import scale_of
from runout.workflow.seeing import structure_meshes
from runout.workflow.study import Study

if TYPE_CHECKING:
    import pandas as pd

    from runout.view.scene import FlowScene

LOGGER = logging.getLogger("runout.stills")
SIZE = (960, 540)  # [pixel]
QUALITY = 82  # of WebP, which is a fraction of the size of a PNG
CAPTION = "maximum over the whole run"
ON_GROUND = "; flow on or under structures is drawn on the ground"
REPEAT = "`runout report --force` tries again"


def member_stills(study: Study, valid: "pd.DataFrame", chosen: str) -> dict[str, Any]:
    """Content of the section of the report: pictures of the maximum thickness of members, or why some are missing.

    Parameters
    ----------
    study : Study
    valid : DataFrame
        Valid members with ``file`` and ``runout_distance``.
    chosen : str
        "worst" (the longest runout; of equal ones the first) or "all".
    """
    content: dict[str, Any] = {"pictures": [], "drawn_by": "", "failure": ""}
    if not len(valid):
        return content
    numbers = [int(valid["runout_distance"].idxmax())] if chosen == "worst" else [int(n) for n in valid.index]
    try:
        process.require_packages()
        scenes = {number: _scene(study, number, str(valid["file"][number])) for number in numbers}
        look = common_look(scenes[int(valid["runout_distance"][numbers].idxmax())], list(scenes.values()))
        for number, scene in scenes.items():
            picture, content["drawn_by"] = draw(scene, look)
            distance = f"runout {valid['runout_distance'][number]:.0f} m"
            title = f"Member {number}, {distance}" + (", the longest" if chosen == "worst" else "")
            content["pictures"].append({"title": title, "image": _embedded(picture)})
    except RenderError as error:
        LOGGER.warning("report: %s", error)
        content["failure"] = f"{error}; {REPEAT}"
    return content


def _embedded(png: bytes) -> str:
    """A PNG as the address of a WebP inside a page."""
    from PIL import Image

    return address(Image.open(BytesIO(png)).convert("RGB"), "webp", quality=QUALITY)


def common_look(longest: "FlowScene", scenes: "Sequence[FlowScene]") -> dict[str, Any]:
    """Look with the colour scale of all scenes and the direction that is the best for the longest runout."""
    top = max(scale_of(scene, "thickness").top for scene in scenes)
    caption = CAPTION + (ON_GROUND if any(scene.meshes for scene in scenes) else "")
    return {"caption": caption, "size": SIZE, "top": top, "direction": best_direction(longest, SIZE[0] / SIZE[1])}


def draw(scene: "FlowScene", look: Mapping[str, Any]) -> tuple[bytes, str]:
    """PNG of the first frame of a scene, of 256 colours, and what it was drawn by.

    Raises RenderError if it cannot be drawn.
    """
    with process.folder_for_job() as folder:
        made = {path.suffix: path for path in process.make("frames", scene, look, folder)}
        return paletted(made[".png"]), made[".txt"].read_text(encoding="utf-8")


def _scene(study: Study, number: int, file: str) -> "FlowScene":
    from runout.ensemble.member import members_folder, plan_members

    site = study.site
    terrain, member = site.terrain(), plan_members(site)[number]
    return maximum_scene(
        members_folder(study.results) / file, terrain, site.releases(sample=member.parameters),
        title=f"{site.settings.title or site.name}, member {number}",
        least_thickness=site.settings.simulation.arrival_threshold, meshes=structure_meshes(site),
    ).coarsened()  # fmt: skip

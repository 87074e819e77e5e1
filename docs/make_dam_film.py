"""Make the still and the film of dam_demo: ``python docs/make_dam_film.py``. It simulates one member, about ten seconds."""

import tempfile
from dataclasses import replace
from pathlib import Path

from runout.view.film import paletted
from runout.workflow.seeing import Choices, animate

HERE = Path(__file__).parent
SITE, IMAGES = HERE.parent / "sites" / "dam_demo", HERE / "images"
CHOICES = Choices(member=4, frames=40, size=(960, 540))
FRAME, SMALL, FPS = 25, (640, 360), 8.0


def main() -> None:
    """Write ``dam_demo_3d.png`` and ``dam_demo.gif``."""
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / "results"
        (frames,) = animate(SITE, results, CHOICES, Path(folder) / "frames", None, fps=FPS)
        (IMAGES / "dam_demo_3d.png").write_bytes(paletted(frames / f"frame_{FRAME:04d}.png"))
        animate(SITE, results, replace(CHOICES, frames=20, size=SMALL), IMAGES / "dam_demo.gif", None, fps=FPS)
    print(f"wrote dam_demo_3d.png and dam_demo.gif in {IMAGES}")


if __name__ == "__main__":
    main()

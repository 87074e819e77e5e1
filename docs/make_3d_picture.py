"""Make the picture of the guide to 3D: ``python docs/make_3d_picture.py``. It simulates one member of jacksboro."""

import tempfile
from pathlib import Path

from runout.view.film import paletted
from runout.workflow.seeing import Choices, animate

HERE = Path(__file__).parent
SITE, PICTURE = HERE.parent / "sites" / "jacksboro", HERE / "images" / "seeing.png"
CHOICES = Choices(member=4, frames=40, size=(960, 540))
FRAME = 12


def main() -> None:
    """Write the picture."""
    with tempfile.TemporaryDirectory() as folder:
        (frames,) = animate(SITE, Path(folder), CHOICES, Path(folder) / "frames", None, fps=10.0)
        PICTURE.write_bytes(paletted(frames / f"frame_{FRAME:04d}.png"))
    print(f"wrote {PICTURE}")


if __name__ == "__main__":
    main()

"""Make the film of runout: ``python docs/make_film.py FILM.mp4``, two minutes; ``--seconds 20 --fps 5`` makes a preview.

It simulates one member of three example sites, and draws each as ``runout animate`` does, between cards with what is seen and the
command that makes it. `--out FOLDER` keeps the simulations, so that another film of them takes the drawing alone.
"""

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from runout.view.film import write_film
from runout.workflow.seeing import Choices, animate

SITES = Path(__file__).parents[1] / "sites"
SIZE = (1280, 720)
PAPER, INK, SOFT = "#1d2b36", "#f3f6f8", "#b8c6d1"
CARD_SHARE, MOST_FRAMES = 0.2, 400  # of the film that is cards; of a scene
MOMENTS = (4, 3)  # columns and rows of the preview
TITLE = ("runout", "From a DEM and a release to hazard maps,\nin three dimensions.", "")
END = ("Your own site", "Three commands: new, check, run.", "runout new mysite --dem dem.tif --release release.gpkg")


@dataclass(frozen=True)
class Scene:
    """A member of a site on the screen, and the card before it."""

    site: str
    words: str
    choices: Choices


SCENES = (
    Scene("frank_slide", "Frank Slide, Alberta, 1903: the mapped failed mass on its sliding surface.", Choices(member=0)),
    Scene(
        "jacksboro",
        "Real terrain, a hypothetical release: speed of the particles.",
        Choices(member=4, colour="speed", show="particles"),
    ),
    Scene("dam_demo", "A dam, a gallery and buildings in the flow (synthetic).", Choices(member=4, show="particles")),
)


def main() -> None:
    """Write the film."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("film", type=Path)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--size", type=int, nargs=2, default=SIZE)
    parser.add_argument("--fps", type=float, default=10.0, help="pictures a second")
    parser.add_argument("--preview", type=Path, help="picture with moments of the film, for docs/guide/seeing.md")
    parser.add_argument("--out", type=Path, help="folder that keeps the simulations")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        frames = list(pictures(Path(folder), asked.out or Path(folder), asked.seconds, asked.fps, tuple(asked.size)))
        write_film(frames, [k / asked.fps for k in range(len(frames))], asked.film, asked.fps)
        if asked.preview:
            write_preview(frames, asked.preview)
    print(f"wrote {asked.film}: {len(frames) / asked.fps:.0f} s")


def pictures(folder: Path, results: Path, seconds: float, fps: float, size: tuple[int, int]) -> Iterator[Path]:
    """PNG files of the film in their order, all of one size [pixel]; ``results`` keeps the simulations."""
    from dataclasses import replace

    cards = round(CARD_SHARE * seconds * fps / (len(SCENES) + 2))
    count = min(MOST_FRAMES, round((1.0 - CARD_SHARE) * seconds * fps / len(SCENES)))
    yield from [card(folder / "title.png", TITLE, size)] * cards
    for scene in SCENES:
        command = f"runout animate sites/{scene.site} --member {scene.choices.member}"
        yield from [card(folder / f"{scene.site}.png", (scene.site, scene.words, command), size)] * cards
        choices = replace(scene.choices, frames=count, size=size)
        (made,) = animate(SITES / scene.site, results / scene.site, choices, folder / f"{scene.site}_frames", None, fps)
        drawn = sorted(made.glob("*.png"))
        yield from (drawn[k * len(drawn) // count] for k in range(count))  # a flow at rest has fewer pictures
    yield from [card(folder / "end.png", END, size)] * cards


def write_preview(frames: list[Path], path: Path) -> None:
    """Write moments of a film at equal distances beside and below each other."""
    from PIL import Image

    columns, rows = MOMENTS
    shown = [Image.open(frames[(2 * k + 1) * len(frames) // (2 * columns * rows)]).convert("RGB") for k in range(columns * rows)]
    width, height = shown[0].size
    sheet = Image.new("RGB", (columns * width, rows * height))
    for k, picture in enumerate(shown):
        sheet.paste(picture, (k % columns * width, k // columns * height))
    sheet.quantize(256).save(path, optimize=True)


def card(path: Path, text: tuple[str, str, str], size: tuple[int, int]) -> Path:
    """A card with a heading, a sentence and a command."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100, facecolor=PAPER)
    big = size[0] / 1280
    figure.text(0.08, 0.62, text[0], color=INK, fontsize=44 * big, weight="bold", parse_math=False)
    figure.text(0.08, 0.54, text[1], color=INK, fontsize=22 * big, va="top", linespacing=1.5, parse_math=False)
    figure.text(0.08, 0.2, text[2], color=SOFT, fontsize=18 * big, family="monospace", parse_math=False)
    figure.savefig(path, facecolor=PAPER)
    return path


if __name__ == "__main__":
    main()

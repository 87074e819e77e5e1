"""Make the pictures of a report for docs/guide/outputs/report.md: ``python docs/make_report_pictures.py REPORT [FOLDER]``.

REPORT is the report.html of a site. The Chromium of Qt draws the first screen at the width of a desk and of a phone, and prints;
PDFium draws the first sheet of the print. No window is needed.
"""

import base64
import io
import sys
import tempfile
from pathlib import Path

import pypdfium2 as pdfium
from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "report"))
from browser import READY, Page  # noqa: E402

SCREENS = {"report_desk.png": (1280, 1000), "report_phone.png": (390, 844)}  # width and height of the window [pixel]
TALLEST = 1500  # pixels of a page that a picture shows, from the top
SHEET, SHEET_NUMBER, SHEET_DPI = "report_sheet", 1, 80
POINTS_AN_INCH = 72.0
COLOURS = 256  # of a picture, so that it is small; rare ones, such as those of a legend, stay


def main(report: Path, folder: Path) -> list[Path]:
    """Paths of the pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = [write(folder / name, screen(report, *size)) for name, size in SCREENS.items()]
    return [*pictures, write(folder / f"{SHEET}.png", sheet(report))]


def screen(report: Path, width: int, height: int) -> Image.Image:
    """Picture of the top of a report in a window of that size."""
    with tempfile.TemporaryDirectory() as folder, Page(Path(folder), width=width, height=height) as page:
        page.open(report, READY)
        page.run("new Promise((done) => setTimeout(done, 1500))")  # the map draws its pictures after it is ready
        clip = {"x": 0, "y": 0, "width": width, "height": TALLEST, "scale": 1}
        png = page.call("Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True)["data"]
        return Image.open(io.BytesIO(base64.b64decode(png)))


def sheet(report: Path) -> Image.Image:
    """Picture of a sheet of the print of a report."""
    with tempfile.TemporaryDirectory() as folder, Page(Path(folder)) as page:
        page.open(report, READY)
        with pdfium.PdfDocument(page.print_pdf()) as document:
            return document[SHEET_NUMBER - 1].render(scale=SHEET_DPI / POINTS_AN_INCH).to_pil()


def write(path: Path, picture: Image.Image) -> Path:
    """Path of a picture with few colours."""
    picture.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(path, optimize=True)
    return path


if __name__ == "__main__":
    for made in main(Path(sys.argv[1]).absolute(), Path(sys.argv[2]) if len(sys.argv) > 2 else ROOT / "docs" / "images"):
        print(made)

"""Make the pictures of a report for docs/guide/outputs/report.md: ``python docs/make_report_pictures.py REPORT [FOLDER]``.

REPORT is the report.html of a site. Chromium draws the first screen at the width of a desk and of a phone, and prints; pdftoppm of
poppler draws the first sheet of the print. No window is needed.
"""

import base64
import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "report"))
from browser import READY, Page  # noqa: E402

SCREENS = {"report_desk.png": (1280, 1000), "report_phone.png": (390, 844)}  # width and height of the window [pixel]
TALLEST = 1500  # pixels of a page that a picture shows, from the top
SHEET, SHEET_NUMBER, SHEET_DPI = "report_sheet", 1, 80
COLOURS = 256  # of a picture, so that it is small; rare ones, such as those of a legend, stay


def main(report: Path, folder: Path) -> list[Path]:
    """Paths of the pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = [write(folder / name, screen(report, *size)) for name, size in SCREENS.items()]
    return [*pictures, *([] if shutil.which("pdftoppm") is None else [write(folder / f"{SHEET}.png", sheet(report))])]


def screen(report: Path, width: int, height: int) -> bytes:
    """PNG of the top of a report in a window of that size."""
    profiles = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)  # Chromium may still write there
    with profiles as profile, Page(Path(profile), width=width, height=height) as page:
        page.open(report, READY)
        page.run("new Promise((done) => setTimeout(done, 1500))")  # the map draws its pictures after it is ready
        clip = {"x": 0, "y": 0, "width": width, "height": TALLEST, "scale": 1}
        return base64.b64decode(page.call("Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True)["data"])


def sheet(report: Path) -> bytes:
    """PNG of a sheet of the print of a report."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:  # Chromium may still write there
        printed, picture = Path(folder) / "report.pdf", Path(folder) / SHEET
        with Page(Path(folder) / "profile") as page:
            page.open(report, READY)
            printed.write_bytes(base64.b64decode(page.call("Page.printToPDF", preferCSSPageSize=True)["data"]))
        numbers = ["-f", str(SHEET_NUMBER), "-l", str(SHEET_NUMBER)]
        command = ["pdftoppm", "-png", "-r", str(SHEET_DPI), *numbers, "-singlefile", str(printed), str(picture)]
        subprocess.run(command, check=True)
        return picture.with_suffix(".png").read_bytes()


def write(path: Path, png: bytes) -> Path:
    """Path of a picture with few colours."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(path, optimize=True)
    return path


if __name__ == "__main__":
    for made in main(Path(sys.argv[1]).absolute(), Path(sys.argv[2]) if len(sys.argv) > 2 else ROOT / "docs" / "images"):
        print(made)

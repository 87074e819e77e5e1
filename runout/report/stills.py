"""Pictures of members in three dimensions, for the report."""

from dataclasses import dataclass
from io import BytesIO
from typing import Any

QUALITY = 82  # of WebP


@dataclass(frozen=True)
class Stills:
    """Pictures of the maximum thickness of members."""

    pictures: tuple[tuple[str, bytes], ...] = ()  # title and PNG of each
    drawn_by: str = ""  # versions and driver: the pixels depend on them
    failure: str = ""  # why pictures are missing; empty if none is

    def content(self) -> dict[str, Any]:
        """Content of the template."""
        from runout.report.html import embedded

        shown = [{"title": title, "image": embedded(_webp(picture), "webp")} for title, picture in self.pictures]
        return {"pictures": shown, "drawn_by": self.drawn_by, "failure": self.failure}


def _webp(picture: bytes) -> bytes:
    """A PNG as WebP, which is a fraction of its size."""
    from PIL import Image

    buffer = BytesIO()
    Image.open(BytesIO(picture)).convert("RGB").save(buffer, "webp", quality=QUALITY)
    return buffer.getvalue()

"""Links of HTML pages."""

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Links(HTMLParser):
    """Targets that a page links to or shows, and the anchors that it has."""

    def __init__(self, page: Path):
        super().__init__()
        self.targets: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        """Note what a tag refers to and what it is called."""
        found = dict(attrs)
        self.targets.update(found[name] for name in ("href", "src") if found.get(name))
        self.anchors.update(found[name] for name in ("id", "name") if found.get(name))


def broken(folder: Path) -> list[str]:
    """Links of all pages below a folder to a file or an anchor that is not there; addresses of the network are not looked at."""
    pages = {path.resolve(): Links(path) for path in folder.rglob("*.html") if "_static" not in path.parts}
    lost = []
    for page, links in pages.items():
        for target in sorted(links.targets):
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            file = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            anchors = pages[file].anchors if file in pages else None
            if not file.exists() or (parts.fragment and anchors is not None and unquote(parts.fragment) not in anchors):
                lost.append(f"{page.name}: {target}")
    return lost

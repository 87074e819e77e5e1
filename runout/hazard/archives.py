"""Documents that programs of maps open: texts made of templates, in archives with the same bytes for the same content."""

import re
import zipfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from runout.io.atomic import read_json, whole_file

_EPOCH = (1980, 1, 1, 0, 0, 0)  # of every file of an archive
_NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def filled(template: str, content: Mapping[str, Any]) -> str:
    """XML text of a template of ``runout/hazard/templates``; texts are escaped, and characters that XML does not have left out."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(lambda name: files("runout.hazard").joinpath("templates", name).read_text(encoding="utf-8")),
    )
    return _NOT_IN_XML.sub("", environment.get_template(template).render(**content))


def write_archive(path: Path, contents: Mapping[str, bytes], mode: int | None = None) -> Path:
    """Write a ZIP archive of files by name, completely or not at all; ``mode`` are its permissions. Returns the path."""
    with whole_file(path) as temporary:
        with zipfile.ZipFile(temporary, "w") as archive:
            for name, content in contents.items():
                entry = zipfile.ZipInfo(name, _EPOCH)
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, content)
        if mode is not None:
            temporary.chmod(mode)
    return path


def earlier_archives(results: Path, suffix: str) -> set[Path]:
    """Archives with a suffix that the run before wrote into a results folder, as its ``run.json`` lists them."""
    listed = read_json(results / "run.json").get("products", [])
    names = [str(one.get("name", "")) for one in listed if isinstance(one, dict)] if isinstance(listed, list) else []
    return {results / name for name in names if name.endswith(suffix) and Path(name).name == name}

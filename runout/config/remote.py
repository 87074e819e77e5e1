"""A public file as site.yaml states it."""

from typing import Annotated

from pydantic import AfterValidator, Discriminator, Tag

from runout.config.distributions import Settings, quantity, refuse, shape
from runout.config.quantities import Text


def _below_data(path: str) -> str:
    """The path; refused where it leads out of the folder."""
    parts = path.replace("\\", "/").split("/")
    if not path.isprintable() or path[:1] in ("", "/", "\\", "~") or ":" in parts[0] or {"..", ""} & set(parts):
        raise refuse(f"{path!r} does not lie below the folder RUNOUT_DATA", "write a relative path without .. in it")
    return path


BelowData = Annotated[str, AfterValidator(_below_data)]


class RemoteFile(Settings):
    """A public file that is fetched once into the user's cache and checked."""

    url: str = quantity("where the file is fetched from", pattern=r"^https://[^/\s]", hint="begin with https://")
    sha256: str = quantity("SHA-256 of the file", pattern=r"^[0-9a-f]{64}$", hint="64 digits 0-9a-f; `sha256sum FILE` prints it")
    size: int = quantity("size of the file", gt=0, unit="bytes")
    path: BelowData | None = quantity("path below the folder RUNOUT_DATA, where a copy is looked for first", None)


InputFile = Annotated[Text | Annotated[RemoteFile, Tag("<block>")], Discriminator(shape)]

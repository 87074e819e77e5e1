"""Finds input files: in the site folder, in the folder RUNOUT_DATA, or by download into the user's cache. Checks them."""

import hashlib
import logging
import os
import re
import time
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urljoin, urlsplit

from pydantic import AfterValidator, Discriminator, Tag

from runout.config.distributions import Settings, quantity, refuse, shape
from runout.config.quantities import Text
from runout.config.stated_at import without_folder
from runout.errors import InputError, StorageError
from runout.io.boundary import exists, require_regular
from runout.io.references import file_in, with_file

DATA_FOLDER = "RUNOUT_DATA"
CACHE_FOLDER = "RUNOUT_CACHE"
LONGEST_NAME = 80  # characters of a file name in the cache

LOGGER = logging.getLogger(__name__)
SCHEMES = ("https",)
MOST_REDIRECTS = 5
TIMEOUT = 30.0  # [s] without an answer of the server
PATIENCE = 60.0  # [s] for a file of no size, and
SLOWEST = 2e4  # bytes per second for the rest
CHUNK = 65536
REDIRECTS = (301, 302, 303, 307, 308)


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


def locate(source: str | RemoteFile, folder: Path) -> str | Path:
    """Path of an input; for one raster of several in a file its GDAL name with that path; the name of a sample is not changed.

    ``source``: path relative to ``folder``, ``NETCDF:"PATH":VARIABLE`` and the like, ``matplotlib:NAME``, or a public file.
    ``folder``: folder of the site. Raises InputError if a public file does not have the stated size and checksum; if a file on
    this machine is a pipe, a device or empty. Raises StorageError if it cannot be fetched or the cache cannot be written.
    """
    if isinstance(source, RemoteFile):
        return fetch(source)
    if source.startswith("matplotlib:"):
        return source
    path = folder / file_in(source)
    if exists(path):  # its reader reports a missing file
        require_regular(path, InputError)
    return path if file_in(source) == source else with_file(source, path)


def fetch(remote: RemoteFile) -> Path:
    """Path of a checked copy of a public file: in RUNOUT_DATA, else in the cache, else downloaded to the cache."""
    local_copy = _in_data_folder(remote)
    if local_copy:
        return _checked(local_copy, remote, f"remove it, or unset {DATA_FOLDER} to fetch the file")
    cached = cached_path(remote)
    if cached.is_file():
        return _checked(cached, remote, "remove it, and it is fetched again")
    return _checked(_download(remote, cached), remote, "the file at the source has changed; ask for the right checksum")


def cache_folder() -> Path:
    """Folder of downloaded files: RUNOUT_CACHE, or the cache folder of the platform."""
    folder = os.environ.get(CACHE_FOLDER)
    if folder:
        return Path(folder).expanduser()
    import pooch

    return Path(pooch.os_cache("runout"))


def cached_path(remote: RemoteFile) -> Path:
    """Path of a public file in the cache; it contains the checksum, so that files of equal names differ."""
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", remote.url.rsplit("/", 1)[-1])[-LONGEST_NAME:]
    return cache_folder() / f"{remote.sha256[:12]}-{name}"


def without_fetched_folders(text: str) -> str:
    """A message whose files in RUNOUT_DATA are relative to it, and whose files in the cache have the name that their URL has."""
    folder = os.environ.get(DATA_FOLDER)
    if folder:
        text = without_folder(text, os.path.normpath(Path(folder).expanduser()))
    return without_folder(text, str(cache_folder()), "[0-9a-f]{12}-")


def _in_data_folder(remote: RemoteFile) -> Path | None:
    setting = os.environ.get(DATA_FOLDER)
    if not setting or not remote.path:
        return None
    folder = Path(setting).expanduser()
    path = Path(os.path.normpath(folder / remote.path))
    if not path.is_relative_to(os.path.normpath(folder)):
        raise InputError(f"{remote.path}: lies outside {DATA_FOLDER}; state a path below that folder")
    return path if path.is_file() else None


def _checked(path: Path, remote: RemoteFile, remedy: str) -> Path:
    size = path.stat().st_size
    if size != remote.size:
        raise InputError(f"{path}: {size} bytes instead of {remote.size}; it is not {remote.url} as stated; {remedy}")
    with open(path, "rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    if digest != remote.sha256:
        raise InputError(f"{path}: its sha256 is {digest} instead of {remote.sha256}; it is not {remote.url} as stated; {remedy}")
    return path


def _download(remote: RemoteFile, target: Path) -> Path:
    """Download a file to a temporary name beside ``target``, check it, and move it to ``target``."""
    import pooch
    from requests.exceptions import RequestException

    _require_writable(target.parent)
    pooch.get_logger().setLevel(logging.WARNING)
    LOGGER.info("fetching %s (%d bytes) into %s", remote.url, remote.size, target.parent)

    def fetcher(url: str, part: str | os.PathLike[str], _: object) -> None:
        download(url, remote.size, Path(part))

    try:
        pooch.retrieve(remote.url, f"sha256:{remote.sha256}", fname=target.name, path=target.parent, downloader=fetcher)
    except RequestException as error:
        raise StorageError(_by_hand(remote, target, type(error).__name__)) from error
    except InputError as error:
        raise InputError(f"{error}; {_get_copy(remote, target)}") from error
    except ValueError as error:  # pooch has removed the file
        raise InputError(
            f"{remote.url}: the file of the server does not have the sha256 {remote.sha256}; {_get_copy(remote, target)}"
        ) from error
    except OSError as error:
        raise StorageError(f"{target}: cannot be written ({error.strerror or error}); {_other_cache()}") from error
    return target


def _require_writable(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"{folder}: the cache cannot be made ({error.strerror}); {_other_cache()}") from error
    if not os.access(folder, os.W_OK):
        raise StorageError(f"{folder}: the cache cannot be written; {_other_cache()}")


def _other_cache() -> str:
    return f"free space or mend its permissions, or set {CACHE_FOLDER} to another folder"


def _by_hand(remote: RemoteFile, target: Path, reason: str) -> str:
    return f"{remote.url}: cannot be fetched ({reason}); {_get_copy(remote, target)}"


def _get_copy(remote: RemoteFile, target: Path) -> str:
    copy = f"get the file by hand ({remote.size} bytes, sha256 {remote.sha256}) and put it at {target}"
    return copy + (f", or set {DATA_FOLDER} to a folder that holds {remote.path}" if remote.path else "")


def download(url: str, size: int, target: Path) -> None:
    """Download a file to ``target``; after an error, an incomplete file may remain.

    ``url``: address; it and all redirections must begin with https. ``size``: stated size of the file [bytes]; the download stops
    as soon as the server sends more. Raises InputError if the server sends another size, redirects too often or away from https.
    Raises StorageError if the download takes too long. Raises requests.exceptions.RequestException or OSError if the server does
    not answer or the file cannot be written.
    """
    import requests

    deadline = time.monotonic() + PATIENCE + size / SLOWEST
    with requests.Session() as session:
        answer = _followed(session, url)
        with answer, open(target, "wb") as file:
            answer.raise_for_status()
            received = 0
            for part in answer.iter_content(CHUNK):
                received += len(part)
                if received > size:
                    raise InputError(
                        f"{url}: the server sends more than the stated {size} bytes; correct size and sha256, or the url"
                    )
                if time.monotonic() > deadline:
                    raise StorageError(f"{url}: only {received} of {size} bytes came in time; try again, or get the file by hand")
                file.write(part)
    if received < size:
        raise InputError(
            f"{url}: the server sent {received} bytes instead of the stated {size}; correct size and sha256, or the url"
        )


def _followed(session: Any, url: str) -> Any:
    """Response after all redirections."""
    for _ in range(MOST_REDIRECTS + 1):
        if urlsplit(url).scheme not in SCHEMES or not urlsplit(url).hostname:
            raise InputError(
                f"{url}: only addresses with https:// are fetched; get the file by hand, or find it at such an address"
            )
        answer = session.get(url, stream=True, allow_redirects=False, timeout=TIMEOUT, headers={"Accept-Encoding": "identity"})
        if answer.status_code not in REDIRECTS or "location" not in answer.headers:
            return answer
        answer.close()
        url = urljoin(url, answer.headers["location"])
    raise InputError(f"{url}: redirected more than {MOST_REDIRECTS} times; state the address that it ends at")

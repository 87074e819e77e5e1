"""Fetching a public file: by https, with few redirects, no more bytes than stated, and in bounded time."""

import time
from pathlib import Path
from typing import Any
from urllib.parse import urljoin, urlsplit

from runout.errors import InputError, StorageError

SCHEMES = ("https",)
MOST_REDIRECTS = 5
TIMEOUT = 30.0  # [s] without an answer of the server
PATIENCE = 60.0  # [s] for a file of no size, and
SLOWEST = 2e4  # bytes per second for the rest
CHUNK = 65536
REDIRECTS = (301, 302, 303, 307, 308)


def download(url: str, size: int, target: Path) -> None:
    """Download a file to ``target``; after an error, an incomplete file may remain.

    Parameters
    ----------
    url : str
        Address; it and all redirections must begin with https.
    size : int
        Stated size of the file [bytes]; the download stops as soon as the server sends more.
    target : Path

    Raises
    ------
    InputError
        If the server sends another size, redirects too often or away from https.
    StorageError
        If the download takes too long.
    requests.exceptions.RequestException, OSError
        If the server does not answer or the file cannot be written.
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

"""Public files: a local server in the place of the public one, the cache, RUNOUT_DATA, and no network at all."""

import contextlib
import gzip
import hashlib
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from pydantic import ValidationError

from runout.config import fetch as fetching
from runout.config.fetch import RemoteFile, cached_path, fetch, without_fetched_folders
from runout.errors import InputError, StorageError

CONTENT = b"ncols 2\nnrows 2\n" * 40
NOBODY = "http://127.0.0.1:9/dem.asc"  # the discard port: nothing listens there


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves a folder and notes what was asked for."""

    asked: list[str] = []  # noqa: RUF012

    def do_GET(self) -> None:
        """Serve a file, a redirect (/to/N/file), or more bytes than a disk holds (/endless)."""
        if self.path.startswith("/to/"):
            count, _, name = self.path.removeprefix("/to/").partition("/")
            self.send_response(302)
            self.send_header(
                "Location", name if "://" in name else f"/to/{int(count) - 1}/{name}" if int(count) > 1 else f"/{name}"
            )
            self.end_headers()
        elif self.path in ("/endless", "/bomb"):
            self.send_response(200)
            if self.path == "/bomb":
                self.send_header("Content-Encoding", "gzip")
            self.end_headers()
            piece = gzip.compress(b"0" * 10_000_000) if self.path == "/bomb" else b"0" * 65536
            with contextlib.suppress(ConnectionError):
                for _ in range(10_000):
                    self.wfile.write(piece)
        else:
            super().do_GET()

    def log_message(self, format: str, *args: object) -> None:
        self.asked.append(self.path)


@pytest.fixture
def server(tmp_path):
    """Address of a server of one file, dem.asc."""
    (tmp_path / "public").mkdir()
    (tmp_path / "public" / "dem.asc").write_bytes(CONTENT)
    QuietHandler.asked.clear()
    served = ThreadingHTTPServer(("127.0.0.1", 0), partial(QuietHandler, directory=str(tmp_path / "public")))
    threading.Thread(target=served.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{served.server_port}/dem.asc"
    served.shutdown()
    served.server_close()


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch) -> Path:
    """An empty cache, no RUNOUT_DATA, no proxy."""
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.delenv("RUNOUT_DATA", raising=False)
    monkeypatch.setattr(fetching, "SCHEMES", ("http",))  # the server of these tests has no certificate
    return tmp_path / "cache"


def remote(url: str, content: bytes = CONTENT) -> RemoteFile:
    stated = {"sha256": hashlib.sha256(content).hexdigest(), "size": len(content), "path": "frank/dem.asc"}
    return RemoteFile.model_construct(url=url, **stated)


def test_public_file_is_fetched_once_and_then_taken_from_the_cache(server, cache):
    first = fetch(remote(server))
    assert first.read_bytes() == CONTENT
    assert first.parent == cache
    assert fetch(remote(server)) == first
    assert QuietHandler.asked == ["/dem.asc"]


def test_fetched_file_that_is_not_the_stated_one_is_refused_and_not_kept(server, cache):
    with pytest.raises(InputError, match="does not have the sha256"):
        fetch(remote(server, CONTENT.replace(b"2", b"3")))
    assert list(cache.iterdir()) == []


def test_copy_in_the_data_folder_wins_over_the_network(tmp_path, monkeypatch, cache):
    copy = tmp_path / "data" / "frank" / "dem.asc"
    copy.parent.mkdir(parents=True)
    copy.write_bytes(CONTENT)
    monkeypatch.setenv("RUNOUT_DATA", str(tmp_path / "data"))
    assert fetch(remote(NOBODY)) == copy
    assert not cache.exists()


@pytest.mark.parametrize("content", [CONTENT[:-1], CONTENT.replace(b"2", b"3")])
def test_copy_in_the_data_folder_with_other_content_is_refused(tmp_path, monkeypatch, content):
    copy = tmp_path / "data" / "frank" / "dem.asc"
    copy.parent.mkdir(parents=True)
    copy.write_bytes(content)
    monkeypatch.setenv("RUNOUT_DATA", str(tmp_path / "data"))
    with pytest.raises(InputError, match=r"frank/dem\.asc: .*instead of.*unset RUNOUT_DATA"):
        fetch(remote(NOBODY))


def test_damaged_file_in_the_cache_is_refused_with_the_remedy(cache):
    cache.mkdir()
    cached_path(remote(NOBODY)).write_bytes(b"damaged")
    with pytest.raises(InputError, match=r"7 bytes instead of 640; .*remove it, and it is fetched again"):
        fetch(remote(NOBODY))


def test_without_network_the_message_says_what_to_put_where(cache):
    wanted = remote(NOBODY)
    with pytest.raises(StorageError) as caught:
        fetch(wanted)
    said = str(caught.value)
    assert said.startswith(f"{NOBODY}: cannot be fetched")
    for part in (f"640 bytes, sha256 {wanted.sha256}", str(cached_path(wanted)), "RUNOUT_DATA", "frank/dem.asc"):
        assert part in said
    assert list(cache.iterdir()) == []


def test_file_put_into_the_cache_by_hand_is_taken(cache):
    cache.mkdir()
    cached_path(remote(NOBODY)).write_bytes(CONTENT)
    assert fetch(remote(NOBODY)).read_bytes() == CONTENT


def test_cache_that_cannot_be_made_is_named_with_the_variable_that_moves_it(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(StorageError, match=r"file/cache: the cache cannot be made .*set RUNOUT_CACHE"):
        fetch(remote(NOBODY))


@pytest.mark.parametrize(("name", "said"), [("endless", "more than the stated 640"), ("bomb", "more than the stated 640")])
def test_a_server_that_sends_too_much_is_left(server, cache, name, said):
    with pytest.raises(InputError, match=said):
        fetch(remote(server.replace("dem.asc", name)))
    assert list(cache.iterdir()) == []


def test_a_file_that_is_too_short_is_refused(server, cache):
    with pytest.raises(InputError, match="640 bytes instead of the stated 641"):
        fetch(remote(server, CONTENT + b"0"))
    assert list(cache.iterdir()) == []


def test_few_redirects_are_followed_and_many_are_not(server):
    assert fetch(remote(server.replace("dem.asc", "to/5/dem.asc"))).read_bytes() == CONTENT
    with pytest.raises(InputError, match="redirected more than 5 times"):
        fetch(remote(server.replace("dem.asc", "to/6/dem.asc#again")))


@pytest.mark.parametrize("url", ["file:///etc/passwd", "ftp://127.0.0.1/a", "http://127.0.0.1/a"])
def test_only_https_is_fetched_after_a_redirect_too(server, url, monkeypatch):
    with pytest.raises(InputError, match="only addresses with https"):
        fetch(remote(server.replace("dem.asc", f"to/1/{url.replace('http:', 'https:')}")))
    monkeypatch.setattr(fetching, "SCHEMES", ("https",))
    QuietHandler.asked.clear()
    with pytest.raises(InputError, match="only addresses with https"):
        fetch(remote(server))
    assert QuietHandler.asked == []


@pytest.mark.parametrize("path", ["../secret.asc", "/etc/passwd", "a/../../b", "~/b", "a\\..\\..\\b", "", "a//b", "C:/b", "a\x00b"])
def test_a_path_out_of_the_data_folder_is_refused(tmp_path, monkeypatch, path):
    stated = {"url": "https://example.org/dem.asc", "sha256": "0" * 64, "size": 9}
    with pytest.raises(ValidationError, match="does not lie below"):
        RemoteFile(**stated, path=path)
    monkeypatch.setenv("RUNOUT_DATA", str(tmp_path / "data"))
    (tmp_path / "secret.asc").write_bytes(CONTENT)
    if path.startswith("../"):
        with pytest.raises(InputError, match="lies outside RUNOUT_DATA"):
            fetch(RemoteFile.model_construct(**stated, path=path))


@pytest.mark.parametrize("url", ["http://127.0.0.1/a", "file:///etc/passwd", "https:///a", "ftp://a/b"])
def test_a_site_states_https_addresses(url):
    with pytest.raises(ValidationError, match="String should match pattern"):
        RemoteFile(url=url, sha256="0" * 64, size=9)


@pytest.mark.parametrize("name", ["..", "%2e%2e", "a" * 500 + ".tif", "a?b=/../../c", "a\x00b"])
def test_the_name_in_the_cache_stays_in_the_cache(cache, name):
    path = cached_path(remote(f"https://example.org/{name}"))
    assert path.resolve().parent == cache.resolve()
    assert len(path.name) < 100


def test_a_message_names_fetched_files_without_their_folders(tmp_path, monkeypatch, cache):
    monkeypatch.setenv("RUNOUT_DATA", str(tmp_path / "data"))
    path = cached_path(RemoteFile(url="https://example.org/a/dem.asc", sha256="0" * 64, size=1))
    said = f"{tmp_path}/data/slide/dem.asc and {path}; {tmp_path}/other.asc"
    assert without_fetched_folders(said) == f"slide/dem.asc and dem.asc; {tmp_path}/other.asc"


def test_a_relative_data_folder_takes_no_part_of_other_paths(monkeypatch):
    monkeypatch.setenv("RUNOUT_DATA", "data")
    assert without_fetched_folders("data/dem.asc: as my-data/dem.asc and inputs/data/x.tif") == (
        "dem.asc: as my-data/dem.asc and inputs/data/x.tif"
    )

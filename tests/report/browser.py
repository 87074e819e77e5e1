"""A page in the Chromium of Qt, a wheel of the package index: it needs no browser of the machine and no window."""

import asyncio
import json
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Any

from tornado.websocket import websocket_connect

ENGINE = Path(__file__).with_name("web_engine.py")
READY = "document.documentElement?.dataset.explorer === 'ready'"  # of a report: its map is drawn
OWN = ("file:", "data:", "blob:", "about:")
PDF = "printed.pdf"
LARGEST_MESSAGE = 1 << 28  # bytes; a picture of a page comes in one message
WAIT = 60.0  # [s] for a page, and for a print


class Page:
    """One page. ``errors`` are exceptions and messages of its console, ``requests`` addresses of the network that it asks for."""

    def __init__(self, folder: Path, width: int = 1280, height: int = 1000, dark: bool = False):
        self.printed = folder / PDF
        command = [sys.executable, str(ENGINE), str(self.printed)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.loop = asyncio.Runner()
        self.number = 0
        self.errors: list[str] = []
        self.requests: list[str] = []
        assert self.process.stdout
        self.socket = self.loop.run(_connected(self.process.stdout.readline().strip()))
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Emulation.setScrollbarsHidden", hidden=True)  # as on a phone; a picture of the whole page has none either
        theme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", features=theme)

    def __enter__(self) -> "Page":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.process.terminate()
        self.process.communicate()
        self.loop.close()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Answer to a command of the DevTools protocol."""
        self.number += 1
        return self.loop.run(self._answer({"id": self.number, "method": method, "params": parameters}))

    async def _answer(self, command: dict[str, Any]) -> dict[str, Any]:
        await self.socket.write_message(json.dumps(command))
        while True:
            message = await self.socket.read_message()
            assert message is not None, "the page has ended"
            answer = json.loads(message)
            if answer.get("id") == command["id"]:
                assert "error" not in answer, answer
                return answer["result"]  # type: ignore[no-any-return]
            self._note(answer)

    def _note(self, event: dict[str, Any]) -> None:
        method, content = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(str(content["exceptionDetails"])[:500])
        elif method == "Log.entryAdded":
            self.errors.append(content["entry"]["text"])
        elif method == "Runtime.consoleAPICalled" and content["type"] in ("error", "warning"):
            self.errors.append(str(content["args"])[:500])
        elif method == "Network.requestWillBeSent" and not content["request"]["url"].startswith(OWN):
            self.requests.append(content["request"]["url"])

    def run(self, script: str) -> Any:
        """Value of an expression in the page."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def open(self, path: Path, ready: str, seconds: float = WAIT) -> None:
        """Open a file and wait until the expression ``ready`` is true."""
        self.call("Page.navigate", url=path.as_uri())
        end = time.monotonic() + seconds
        while not self.run(ready):
            assert time.monotonic() < end, (self.errors, self.run("document.body.innerText.slice(0, 500)"))
            time.sleep(0.1)

    def print_pdf(self, seconds: float = WAIT) -> Path:
        """Path of the print of the page, on upright sheets of A4."""
        self.run("window.print()")
        end = time.monotonic() + seconds
        while not (self.printed.exists() and self.printed.read_bytes().rstrip().endswith(b"%%EOF")):
            assert time.monotonic() < end, "the page was not printed"
            time.sleep(0.1)
        return self.printed


async def _connected(address: str) -> Any:
    """Connection to a page; a page that has just begun takes none yet."""
    end = time.monotonic() + WAIT
    while True:
        try:
            return await websocket_connect(address, max_message_size=LARGEST_MESSAGE)
        except OSError:
            assert time.monotonic() < end, "the page does not answer"
            await asyncio.sleep(0.05)

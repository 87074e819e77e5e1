"""A page in headless Chromium, driven over a pipe: no port, no further library."""

import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
READY = "document.documentElement?.dataset.explorer === 'ready'"  # of a report: its map is drawn
OWN = ("file:", "data:", "blob:", "about:")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--remote-debugging-pipe"),
    *("--no-first-run", "--disable-component-update"),
)


class Page:
    """One page. ``errors`` are exceptions and messages of its console, ``requests`` addresses of the network that it asks for."""

    def __init__(self, folder: Path, width: int = 1280, height: int = 1000, dark: bool = False):
        to_read, self.to = os.pipe()
        self.answers, to_write = os.pipe()
        for end in (to_read, to_write):
            os.set_inheritable(end, True)
        shell = f'exec "$0" "$@" 3<&{to_read} 4>&{to_write}'  # Chromium reads commands from 3 and answers on 4
        command = ["bash", "-c", shell, CHROMIUM, *FLAGS, f"--user-data-dir={folder}"]
        silent: Any = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen(command, pass_fds=(to_read, to_write), **silent)
        for end in (to_read, to_write):
            os.close(end)
        self.number, self.buffer, self.session = 0, b"", ""
        self.errors: list[str] = []
        self.requests: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
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
        self.process.wait()
        os.close(self.to)
        os.close(self.answers)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Answer to a command of the DevTools protocol."""
        self.number += 1
        command = {"id": self.number, "method": method, "params": parameters} | (
            {"sessionId": self.session} if self.session else {}
        )
        os.write(self.to, json.dumps(command).encode() + b"\0")
        while True:
            answer = self._answer()
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]  # type: ignore[no-any-return]
            self._note(answer)

    def _answer(self) -> dict[str, Any]:
        while b"\0" not in self.buffer:
            part = os.read(self.answers, 1 << 20)
            assert part, "Chromium has ended"
            self.buffer += part
        text, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(text)  # type: ignore[no-any-return]

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

    def open(self, path: Path, ready: str, seconds: float = 60.0) -> None:
        """Open a file and wait until the expression ``ready`` is true."""
        self.call("Page.navigate", url=path.as_uri())
        end = time.monotonic() + seconds
        while not self.run(ready):
            assert time.monotonic() < end, (self.errors, self.run("document.body.innerText.slice(0, 500)"))
            time.sleep(0.1)

"""A headless Chromium, driven through its DevTools protocol."""

import base64
import io
import itertools
import json
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import psutil
from PIL import Image

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-extensions", "--hide-scrollbars", "--remote-debugging-port=0"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # WebGL without a GPU
)
START_SECONDS = 300


def executable() -> str | None:
    """The browser that this machine has."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Page:
    """One open page."""

    def __init__(self, socket: Any):
        self._socket, self._numbers = socket, itertools.count(1)

    def call(self, method: str, **parameters) -> dict[str, Any]:
        """The result of a DevTools command; events in between are dropped."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=300))
            if answer.get("id") == number:
                return answer["result"]

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression."""
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def screenshot(self) -> np.ndarray:
        """uint8 [H, W, 3]"""
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))

    def drag(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """The left mouse button from one pixel to another."""
        for kind, (x, y) in (("mousePressed", start), ("mouseMoved", end), ("mouseReleased", end)):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)


@contextmanager
def opened(url: str, width: int = 800, height: int = 600) -> Iterator[Page]:
    """A page of the browser at ``url``; its window has no frame."""
    from websockets.sync.client import connect

    with tempfile.TemporaryDirectory() as profile:
        command = [executable() or "", *FLAGS, f"--window-size={width},{height}", f"--user-data-dir={profile}", url]
        browser = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        assert browser.stderr is not None
        try:
            said = (re.search(r"DevTools listening on ws://[^:]+:(\d+)", line) for line in browser.stderr)
            port = next(found[1] for found in said if found)
            with connect(f"ws://127.0.0.1:{port}{_target(port, url)}", max_size=None) as socket:
                yield Page(socket)
        finally:
            helpers = psutil.Process(browser.pid).children(recursive=True)  # they write to the profile
            for process in (browser, *helpers):
                with suppress(psutil.NoSuchProcess):
                    process.kill()
            browser.stderr.close()
            browser.wait()
            psutil.wait_procs(helpers)


def _target(port: str, url: str) -> str:
    """Path of the page's own socket."""
    from urllib.request import urlopen

    end = time.monotonic() + START_SECONDS
    while time.monotonic() < end:
        with urlopen(f"http://127.0.0.1:{port}/json") as answer:
            pages = [t for t in json.load(answer) if t["type"] == "page" and t["url"].startswith(url.rstrip("/"))]
        if pages:
            return re.sub(r"^ws://[^/]+", "", pages[0]["webSocketDebuggerUrl"])
        time.sleep(0.2)
    raise TimeoutError(f"the browser did not open {url}")

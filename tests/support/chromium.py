"""A headless Chromium, driven over the pipe of its debugging protocol: no library needed."""

import base64
import fcntl
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

NAMES = "chromium", "chromium-browser", "google-chrome"
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
READY = "document.documentElement?.dataset.ready === 'yes' || document.getElementById('trouble')?.hidden === false"
# Becomes the browser, whose pipes are files 3 and 4
AT_THREE_AND_FOUR = "import os, sys; os.dup2(int(sys.argv[1]), 3); os.dup2(int(sys.argv[2]), 4); os.execv(sys.argv[3], sys.argv[3:])"
PATIENCE = 90.0  # seconds for an answer


class Chromium:
    """One page of a browser.

    Attributes
    ----------
    messages : list of str
        What the page said on the console, exceptions and refused requests included.
    """

    def __init__(self, program: str):
        self.profile = tempfile.mkdtemp(prefix="evsdr-chromium-")
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        # Copies first, as one of the pipes may itself be 3 or 4
        to_browser, from_browser = (_above_four(end) for end in (to_browser, from_browser))
        options = [*OPTIONS, f"--user-data-dir={self.profile}", "about:blank"]
        self._process = subprocess.Popen(
            [sys.executable, "-c", AT_THREE_AND_FOUR, str(to_browser), str(from_browser), program, *options],
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._buffer, self._number, self._session, self.messages = b"", 0, None, []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters) -> dict:
        """Call a method of the protocol; gives its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (answer := self._receive()).get("id") != self._number:
            pass
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']['message']}")
        return answer["result"]

    def _receive(self) -> dict:
        while b"\0" not in self._buffer:
            part = os.read(self._read, 1 << 20)
            if not part:
                raise RuntimeError("the browser has ended")
            self._buffer += part
        text, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(text)
        told = message.get("params", {})
        if message.get("method") == "Runtime.consoleAPICalled":
            self.messages.append(" ".join(str(a.get("value", a.get("description"))) for a in told["args"]))
        elif message.get("method") == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.messages.append(details.get("exception", {}).get("description", details["text"]))
        elif message.get("method") == "Log.entryAdded":
            self.messages.append(told["entry"]["text"])
        elif message.get("method") == "Network.requestWillBeSent":
            url = told["request"]["url"]
            if not url.startswith(("file:", "data:", "blob:", "about:")):
                self.messages.append(f"request {url}")
        return message

    def evaluate(self, expression: str):
        """Give the value of a JavaScript expression, awaited."""
        result = self.send(
            "Runtime.evaluate",
            expression=expression,
            awaitPromise=True,
            returnByValue=True,
            timeout=1e3 * PATIENCE,
        )
        if "exceptionDetails" in result:
            raise RuntimeError(
                result["exceptionDetails"].get("exception", {}).get("description", str(result))
            )
        return result["result"].get("value")

    def open(
        self,
        place: Path | str,
        ready: str,
        size: tuple[int, int] = (1280, 900),
        phone: bool = False,
        dark: bool = False,
    ):
        """Open a file, or an address, and wait until an expression is true."""
        width, height = size
        scale = 2 if phone else 1
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=phone,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", media="", features=[scheme])
        self.send("Page.navigate", url=place if isinstance(place, str) else place.resolve().as_uri())
        self.await_true(ready)

    def await_true(self, expression: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.evaluate(expression):
            assert time.monotonic() < end, self.messages
            time.sleep(0.1)

    def screenshot(self, path: Path, whole: bool = False) -> None:
        """Write what is seen, or the whole page, as PNG."""
        picture = self.send("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(picture["data"]))

    def print_pdf(self, path: Path) -> None:
        """Print the page on A4."""
        pdf = self.send(
            "Page.printToPDF",
            printBackground=True,
            paperWidth=8.27,
            paperHeight=11.69,
            preferCSSPageSize=True,
        )
        path.write_bytes(base64.b64decode(pdf["data"]))

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._write)
        os.close(self._read)
        shutil.rmtree(self.profile, ignore_errors=True)


def _above_four(end: int) -> int:
    """Move an end of a pipe away from the numbers that the browser is told."""
    copy = fcntl.fcntl(end, fcntl.F_DUPFD, 10)
    os.close(end)
    return copy


def open_page(browser: Chromium, path: Path, text: str, **how) -> Chromium:
    """Write a page and open it; nothing may be said on the console, nor on the page of trouble."""
    path.write_text(text, encoding="utf-8")
    browser.messages.clear()
    browser.open(path, READY, **how)
    assert browser.messages == []
    assert not browser.evaluate("document.getElementById('trouble').textContent")
    return browser


def start_chromium() -> Chromium:
    """Start the browser; skip the test where there is none."""
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip("no Chromium")
    return Chromium(program)

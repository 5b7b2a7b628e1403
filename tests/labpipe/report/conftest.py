"""A headless browser over a pair of pipes, and pages to show it."""

import base64
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from labpipe.report import MAX_PAGE_BYTES

_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
CHROMIUM = next(filter(None, map(shutil.which, _NAMES)), None) if os.environ.get("LABPIPE_BROWSER") else None
NO_BROWSER = "the pages are not looked at: that takes Chromium, and LABPIPE_BROWSER=1"
SWITCHES = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"),
    *("--disable-dev-shm-usage", "--disable-extensions", "--hide-scrollbars", "--remote-debugging-pipe"),
)


class Browser:
    """Chromium spoken to through ``--remote-debugging-pipe``: JSON texts that end with NUL."""

    def __init__(self, profile: Path) -> None:
        read_here, write_there = os.pipe()
        read_there, write_here = os.pipe()
        # The browser reads its descriptor 3 and writes its descriptor 4.
        plumbing = (
            "import os, sys\n"
            "a, b = os.dup(int(sys.argv[1])), os.dup(int(sys.argv[2]))\n"
            "os.dup2(a, 3), os.dup2(b, 4)\n"
            "os.set_inheritable(3, True), os.set_inheritable(4, True)\n"
            "os.execv(sys.argv[3], sys.argv[3:])"
        )
        ends = (str(read_there), str(write_there))
        self.process = subprocess.Popen(
            [*(sys.executable, "-c", plumbing, *ends, CHROMIUM), *(*SWITCHES, f"--user-data-dir={profile}")],
            pass_fds=(read_there, write_there),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(read_there)
        os.close(write_there)
        self._in = os.fdopen(read_here, "rb", buffering=0)
        self._out = os.fdopen(write_here, "wb", buffering=0)
        self._count = 0
        self._buffer = b""
        self._session = ""
        self.events: list[dict[str, Any]] = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            chunk = self._in.read(1 << 20)
            if not chunk:
                message = "the browser closed its pipe"
                raise EOFError(message)
            self._buffer += chunk
        text, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(text)

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[self._out.write(data) :]
        while (answer := self._receive()).get("id") != self._count:
            self.events.append(answer)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        return answer["result"]

    def navigate(self, address: str) -> None:
        self.events.clear()
        self.send("Page.navigate", url=address)
        while not any(event.get("method") == "Page.loadEventFired" for event in self.events):
            self.events.append(self._receive())

    def open(self, path: Path, *, width: int = 1280, height: int = 900, scripts: bool = True) -> None:
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.send("Emulation.setScriptExecutionDisabled", value=not scripts)
        self.navigate(path.as_uri())
        if scripts:
            self.settle()

    def visit(self, address: str, *, width: int = 1400, height: int = 900) -> None:
        """Open an address; the page may go on asking its server."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        for place in ("about:blank", address):  # the page before may still ask a server that has gone
            self.navigate(place)

    def until(self, script: str, seconds: float = 120.0) -> Any:
        """Return the first value of a script that counts as true; the page is asked again and again."""
        end = time.monotonic() + seconds
        while not (value := self.run(script)):
            if time.monotonic() > end:
                raise TimeoutError(script)
            time.sleep(0.05)
        return value

    def settle(self) -> None:
        """Wait until observers and two frames have run."""
        self.run("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(r, 30))))")

    def run(self, script: str) -> Any:
        result = self.send("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in result:
            raise RuntimeError(json.dumps(result["exceptionDetails"]))
        return result["result"].get("value")

    def media(self, media: str = "", **features: str) -> None:
        named = [{"name": k.replace("_", "-"), "value": v} for k, v in features.items()]
        self.send("Emulation.setEmulatedMedia", media=media, features=named)

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def click(self, x: float, y: float, count: int = 1) -> None:
        for number in range(1, count + 1):
            for kind in ("mousePressed", "mouseReleased"):
                self.mouse(kind, x, y, button="left", clickCount=number)

    def drag(self, start: tuple[float, float], stop: tuple[float, float]) -> None:
        self.mouse("mouseMoved", *start)
        self.mouse("mousePressed", *start, button="left", clickCount=1)
        for share in (0.3, 0.7, 1.0):
            x, y = (a + (b - a) * share for a, b in zip(start, stop, strict=True))
            self.mouse("mouseMoved", x, y, button="left", buttons=1)
        self.mouse("mouseReleased", *stop, button="left", clickCount=1)

    def key(self, name: str) -> None:
        codes = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Home": 36}
        for kind in ("keyDown", "keyUp"):
            code = codes.get(name, 0)
            self.send("Input.dispatchKeyEvent", type=kind, key=name, code=name, windowsVirtualKeyCode=code)

    def pdf(self, path: Path) -> None:
        answer = self.send("Page.printToPDF", preferCSSPageSize=True, paperWidth=8.27, paperHeight=11.69)
        path.write_bytes(base64.b64decode(answer["data"]))

    def complaints(self) -> list[str]:
        """Return console errors, uncaught exceptions and violations of the page's policy."""
        self.run("1")
        found = []
        for event in self.events:
            method, parameters = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                found.append(json.dumps(parameters["exceptionDetails"]))
            if method == "Runtime.consoleAPICalled" and parameters["type"] in {"error", "warning", "assert"}:
                found.append(json.dumps(parameters["args"]))
            if method == "Log.entryAdded":
                found.append(json.dumps(parameters["entry"]))
        return found

    def requests(self) -> list[str]:
        """Return the addresses asked for, apart from those that hold their data themselves."""
        self.run("1")
        asked = (e["params"]["request"]["url"] for e in self.events if e.get("method") == "Network.requestWillBeSent")
        return [address for address in asked if not address.startswith("data:")]

    def close(self) -> None:
        try:
            self._session = ""
            self.send("Browser.close")
        except (EOFError, BrokenPipeError):
            self.process.terminate()
        self.process.wait(timeout=20)
        self._in.close()
        self._out.close()


def opened(profile: Path) -> Iterator[Browser]:
    """A browser for a fixture, closed after it."""
    if CHROMIUM is None:
        pytest.skip(NO_BROWSER)
    started = Browser(profile)
    yield started
    started.close()


class Charts:
    """The charts of the page that is open."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser

    def box(self, place: int) -> tuple[float, float, float, float]:
        """Scroll a chart into view; return left, top, width and height of its plotting area."""
        self.browser.run(
            f"document.querySelectorAll('figure.chart')[{place}]"
            ".scrollIntoView({block: 'center', behavior: 'instant'})"
        )
        self.browser.settle()
        return tuple(
            self.browser.run(
                f"(() => {{ const b = document.querySelectorAll('figure.chart')[{place}]"
                ".querySelector('.u-over').getBoundingClientRect();"
                " return [b.left, b.top, b.width, b.height]; })()"
            )
        )

    def window(self, place: int) -> list[float]:
        """Return the window along x that a chart shows."""
        text = self.browser.run(f"document.querySelectorAll('figure.chart')[{place}].dataset.window")
        return [float(part) for part in text.split()]


def assert_quiet(window: Browser, path: Path, width: int, scheme: str = "light") -> None:
    """Open a page on a screen of a width: nothing is complained of or asked for, and it never scrolls sideways."""
    window.media(prefers_color_scheme=scheme)
    window.open(path, width=width)
    assert window.complaints() == []
    assert window.requests() == [path.as_uri()]
    assert window.run("document.documentElement.scrollWidth") <= width


def assert_fit_to_read(path: Path, profile: Path) -> None:
    """Open a report on a phone and on a large screen: quiet, alone, whole, and small enough."""
    if CHROMIUM is None:
        pytest.skip(NO_BROWSER)
    window = Browser(profile)
    try:
        for width, scheme in ((400, "dark"), (2000, "light")):
            assert_quiet(window, path, width, scheme)
        drawn = "[...document.querySelectorAll('figure.chart')].map(f => Boolean(f.dataset.window))"
        assert all(window.run(drawn))
        assert window.run("document.querySelectorAll('.gallery .frame.is-shown').length") == 1
        canvas = "document.querySelector('.uplot canvas').toDataURL()"
        before = window.run(canvas)
        window.run("document.querySelector('.gallery-next').click()")
        window.settle()
        assert window.run(canvas) != before, "the chart does not mark the frame that is shown"
    finally:
        window.close()
    assert path.stat().st_size <= MAX_PAGE_BYTES


@pytest.fixture
def chart(browser: Browser) -> Charts:
    return Charts(browser)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    yield from opened(tmp_path_factory.mktemp("profile"))
    # The profile's helper processes end a moment after the browser.
    time.sleep(0.05)

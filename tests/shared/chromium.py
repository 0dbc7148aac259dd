"""A headless Chromium, driven by its own DevTools protocol: what the browser tests look through.

with Chromium() as chromium:
    page = chromium.open("http://127.0.0.1:8080")
    page.wait("window.rabbit.state.pictures > 3")
"""

import itertools
import json
import shutil
import subprocess
import tempfile
import time
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self
from urllib.request import urlopen

from websockets.sync.client import ClientConnection, connect

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
OPTIONS = (
    *("--headless=new", "--no-sandbox", "--remote-debugging-port=0", "--no-first-run", "--disable-gpu"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-default-apps"),
)
PATIENCE = 180.0  # s, a guard against hangs
SIZE = {"width": 1280, "height": 800}  # of a window, pixels


def find_chromium() -> str | None:
    """The browser's path; None where there is none."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Chromium:
    """A browser with a profile of its own."""

    def __enter__(self) -> Self:
        self._stack = ExitStack()
        profile = Path(self._stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        command = [str(find_chromium()), *OPTIONS, f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._stack.callback(self._process.wait, timeout=30)
        self._stack.callback(self._process.terminate)
        known = profile / "DevToolsActivePort"
        wait(lambda: known.exists() and known.read_text().count("\n") == 1)
        self._port = int(known.read_text().split()[0])
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def open(self, address: str, offline: bool = False) -> "Page":
        """A new page at `address`, with the network off if `offline`."""
        address_of = f"http://127.0.0.1:{self._port}/json"
        with urlopen(f"{address_of}/version") as answer:
            browser = json.load(answer)["webSocketDebuggerUrl"]
        with attach(browser) as socket:  # a window of its own, since what is hidden is not drawn
            wish = {"url": "about:blank", "newWindow": True, **SIZE}
            socket.send(json.dumps({"id": 1, "method": "Target.createTarget", "params": wish}))
            target = json.loads(socket.recv(timeout=PATIENCE))["result"]["targetId"]
        socket = self._stack.enter_context(attach(f"ws://127.0.0.1:{self._port}/devtools/page/{target}"))
        return Page(socket, address, offline)


class Page:
    """`requests`: addresses of all that it asked for; `errors`: what went wrong in its scripts."""

    def __init__(self, socket: ClientConnection, address: str, offline: bool) -> None:
        self._socket = socket
        self._numbers = itertools.count(1)
        self.requests: list[str] = []
        self.errors: list[str] = []
        for domain in ("Page", "Network", "Runtime"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", **SIZE, deviceScaleFactor=1, mobile=False)
        self.call("Emulation.setFocusEmulationEnabled", enabled=True)
        look = [{"name": "prefers-color-scheme", "value": "light"}]
        self.call("Emulation.setEmulatedMedia", features=look)
        if offline:
            self.go_offline()
        self.call("Page.navigate", url=address)

    def go_offline(self) -> None:
        """No network from now on."""
        none = {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
        self.call("Network.emulateNetworkConditions", **none)

    def call(self, method: str, **parameters: Any) -> Any:
        """A command of the protocol; its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=PATIENCE))
            if message.get("id") == number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                return message["result"]
            self._note(message)

    def look(self, expression: str) -> Any:
        """The value of a JavaScript expression."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def wait(self, expression: str) -> Any:
        """Until the expression is true; its value."""
        found: list[Any] = []

        def is_true() -> bool:
            found[:] = [self.look(f"(() => {{ try {{ return {expression} }} catch {{ return false }} }})()")]
            return bool(found[0])

        wait(is_true, expression)
        return found[0]

    def click(self, selector: str) -> None:
        """The middle of an element, with the mouse."""
        box = self._box(selector)
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def press(self, key: str) -> None:
        """A key."""
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key)

    def drag(self, selector: str, share: float) -> None:
        """A slider's thumb, with the mouse, from where it is to a share of its width."""
        box = self._box(selector)
        inside = 8 + (box["width"] - 16) * share
        now = self.look(f"(s => (s.value - s.min) / (s.max - s.min || 1))({element(selector)})")
        start, y = box["x"] + 8 + (box["width"] - 16) * now, box["y"] + box["height"] / 2
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=start, y=y, button="left", clickCount=1)
        for i in range(1, 6):
            x = start + (box["x"] + inside - start) * i / 5
            self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)
        x = box["x"] + inside
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", clickCount=1)

    def choose(self, selector: str, value: str) -> None:
        """An option of a list, as a person's choice."""
        set_value = f"s.value = {json.dumps(value)}; s.dispatchEvent(new Event('change'))"
        self.look(f"(s => {{ {set_value} }})({element(selector)})")

    def _box(self, selector: str) -> dict[str, float]:
        self.look(f"{element(selector)}.scrollIntoView({{block: 'center'}})")
        box: dict[str, float] = self.look(f"{element(selector)}.getBoundingClientRect().toJSON()")
        assert box["width"] * box["height"], f"{selector} is not to be seen"
        return box

    def _note(self, message: dict[str, Any]) -> None:
        what: dict[str, Any] = defaultdict(dict, message.get("params", {}))
        match message.get("method"):
            case "Network.requestWillBeSent":
                self.requests.append(what["request"]["url"])
            case "Network.webSocketCreated":
                self.requests.append(what["url"])
            case "Runtime.exceptionThrown":
                self.errors.append(json.dumps(what["exceptionDetails"]))
            case "Runtime.consoleAPICalled" if what["type"] == "error":
                self.errors.append(json.dumps(what["args"]))


def attach(address: str) -> ClientConnection:
    """To a browser or a page."""
    return connect(address, max_size=None, compression=None, ping_interval=None)


def element(selector: str) -> str:
    """The JavaScript for it."""
    return f"document.querySelector({json.dumps(selector)})"


def wait(is_done: Any, what: str = "") -> None:
    """Until `is_done()`; raises `TimeoutError`."""
    end = time.monotonic() + PATIENCE
    while not is_done():
        if time.monotonic() > end:
            raise TimeoutError(f"not within {PATIENCE} s: {what}")
        time.sleep(0.02)

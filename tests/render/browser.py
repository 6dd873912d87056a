"""Chromium without a window, driven through its debugging pipe."""

import base64
import io
import json
import os
import shutil
import subprocess
import sys
import time

import numpy as np

from tests.running import rows

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "headless_shell")
OPTIONS = rows(__file__, "options")
WITH_PIPES = (  # which Chromium expects as files 3 and 4
    "import os, sys; import fcntl; a, b = (fcntl.fcntl(int(n), fcntl.F_DUPFD, 10) for n in sys.argv[1:3]);"
    " os.dup2(a, 3); os.dup2(b, 4);"
    " os.execv(sys.argv[3], sys.argv[3:])"
)


def chromium():
    """Path of Chromium; None where it is not installed."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """One page of Chromium.

    errors  what the page has written to the console as an error, or thrown
    """

    def __init__(self, folder, width=900, height=700):
        to_chrome, from_us = os.pipe()
        from_chrome, to_us = os.pipe()
        words = [chromium(), *OPTIONS, f"--user-data-dir={folder}", f"--window-size={width},{height}", "about:blank"]
        self.process = subprocess.Popen(
            [sys.executable, "-c", WITH_PIPES, str(to_chrome), str(to_us), *words], pass_fds=(to_chrome, to_us),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(to_chrome)
        os.close(to_us)
        self.out, self.back = os.fdopen(from_us, "wb", buffering=0), os.fdopen(from_chrome, "rb", buffering=0)
        self.rest, self.number, self.session, self.errors = b"", 0, None, []
        targets = self.call("Target.getTargets")["targetInfos"]
        target = next(t["targetId"] for t in targets if t["type"] == "page")
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.size(width, height)

    def size(self, width, height):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def call(self, method, **parameters):
        """Result of a command of the debugging protocol."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session is not None:
            message["sessionId"] = self.session
        self.out.write(json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.rest:
                piece = self.back.read(1 << 20)
                assert piece, "Chromium has ended"
                self.rest += piece
            one, _, self.rest = self.rest.partition(b"\0")
            answer = json.loads(one)
            self._look(answer)
            if answer.get("id") == self.number:
                assert "error" not in answer, answer["error"]
                return answer["result"]

    def _look(self, answer):
        method, found = answer.get("method"), answer.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(found["exceptionDetails"].get("exception", {}).get("description", "exception"))
        elif method == "Runtime.consoleAPICalled" and found["type"] == "error":
            self.errors.append(str(found["args"]))
        elif method == "Log.entryAdded" and found["entry"]["level"] == "error":
            self.errors.append(found["entry"]["text"])

    def value(self, expression):
        """What an expression of JavaScript gives."""
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def open(self, path, ready="document.readyState === 'complete'", seconds=90):
        """Open a file and wait until it is ready."""
        self.call("Page.navigate", url=path.resolve().as_uri())
        end = time.monotonic() + seconds
        while not self.value(ready):
            assert time.monotonic() < end, f"{path} is not ready after {seconds} s; {self.errors}"
            time.sleep(0.05)

    def place(self, selector):
        """Centre (x, y) [pixels] of an element, which is scrolled into view."""
        return self.value(
            f"(() => {{ const one = document.querySelector({json.dumps(selector)});"
            " one.scrollIntoView({block: 'center'});"
            " const box = one.getBoundingClientRect();"
            " return [box.x + box.width / 2, box.y + box.height / 2]; })()"
        )

    def click(self, selector):
        """Press and release the mouse on the centre of an element."""
        self.drag(self.place(selector))

    def drag(self, *places):
        """Press the mouse at the first place [pixels], move it over the others, and release it."""
        for kind, (x, y) in zip(("mousePressed", *("mouseMoved",) * (len(places) - 1)), places):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
        x, y = places[-1]
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", clickCount=1)

    def touch(self, *places):
        """Put a finger down at the first place [pixels], move it over the others, and lift it."""
        for kind, (x, y) in zip(("touchStart", *("touchMove",) * (len(places) - 1)), places):
            self.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}])
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def press(self, key, times=1):
        """Press a key, by its name in the browser."""
        code = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Tab": 9, "Enter": 13}[key]
        more = {"text": "\r"} if key == "Enter" else {}
        for _ in range(times):
            for kind in ("keyDown", "keyUp"):
                self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code, **more)

    def write(self, words):
        """Write into the element that has the focus."""
        self.call("Input.insertText", text=words)

    def picture(self, whole=False):
        """(height, width, 3) pixels of the page."""
        from PIL import Image

        data = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)["data"]
        return np.array(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))

    def close(self):
        self.process.terminate()
        self.process.wait(20)
        self.out.close()
        self.back.close()

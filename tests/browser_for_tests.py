"""Pages in a headless Chromium with software WebGL: what a script finds out there, and how long frames take."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest

_FLAGS = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--hide-scrollbars"),
]
_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")

# Frames are drawn at once, not when the screen is ready: a step is over when its call returns.
_AT_ONCE = "<script>window.requestAnimationFrame = (draw) => { draw(); return 0; };</script>"
_DRIVER = """
const canvases = () => [...document.querySelectorAll(".panel canvas")];
const pixels = (canvas) => canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
const drawn = (canvas) => pixels(canvas).filter((value, i) => i % 4 === 3 && value > 0).length;
const sums = () => canvases().map((canvas) => pixels(canvas).reduce((sum, value) => (sum * 31 + value) >>> 0, 0));
const mean = (canvas) => {
  const p = pixels(canvas), total = [0, 0, 0]; let count = 0;
  for (let i = 0; i < p.length; i += 4) if (p[i + 3]) { count++; for (let c = 0; c < 3; c++) total[c] += p[i + c]; }
  return total.map((value) => value / count);
};
const choose = (mode) => document.querySelector(`[data-mode='${mode}']`).click();
const slide = (name, value) => {
  const slider = document.querySelector(`[data-control='${name}']`);
  slider.value = value; slider.dispatchEvent(new Event("input"));
};
const press = (canvas, key, more = {}) =>
  canvas.dispatchEvent(new KeyboardEvent("keydown", { key, cancelable: true, ...more }));
const pointer = (canvas, kind, x, y, more = {}) => {
  const event = { pointerId: 1, clientX: x, clientY: y, buttons: 1, ...more };
  canvas.dispatchEvent(new PointerEvent("pointer" + kind, event));
};
"""


def chromium() -> str:
    """The browser's command; the test is skipped where none is installed."""
    found = next(filter(None, map(shutil.which, _NAMES)), None)
    if found is None:
        pytest.skip("no Chromium is installed (apt-get install chromium)")
    return found


def found_in(page: str, script: str, folder: Path, size: tuple[int, int] = (900, 500)) -> Any:
    """What the body of a JavaScript function returns that runs once the page has started.

    Args:
        page: HTML; its policy, which forbids any script but its own, is taken off for this.
        script: may use the functions of the driver: `canvases()`, `drawn(canvas)`, `choose(mode)` and so on.
        folder: an empty one, for the page and the browser.
    """
    body = f"document.body.dataset.found = JSON.stringify((() => {{ {script} }})());"
    path = _with_script(page, body, folder)
    dom = run_chromium(path, folder, "--dump-dom", size=size)
    match = re.search(r"<body[^>]* data-found=\"([^\"]*)\"", dom)
    assert match, dom[-2000:]
    return json.loads(unescape(match[1]))


def pictured(page: str, script: str, folder: Path, picture: Path, size: tuple[int, int]) -> None:
    """Write a PNG of a page as it is after the script has run; arguments as of `found_in`."""
    run_chromium(_with_script(page, script, folder), folder, f"--screenshot={picture}", size=size)


def _with_script(page: str, body: str, folder: Path) -> Path:
    page = re.sub(r"<meta http-equiv=\"Content-Security-Policy\"[^>]*>", _AT_ONCE, page)
    listener = f"<script>document.addEventListener('DOMContentLoaded', () => {{ {_DRIVER} {body} }});</script></body>"
    path = folder / "page.html"
    path.write_text(page.replace("</body>", listener), encoding="utf-8")
    return path


def run_chromium(path: Path, folder: Path, *flags: str, size: tuple[int, int] = (900, 500)) -> str:
    """What the browser prints for a page."""
    command = [chromium(), *_FLAGS, f"--user-data-dir={folder / 'browser'}", f"--window-size={size[0]},{size[1]}"]
    done = subprocess.run([*command, *flags, path.as_uri()], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout

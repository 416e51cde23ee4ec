"""How long the viewer takes for a frame in the browser at hand: `python docs/measure_view.py POINTS [WIDTH HEIGHT]`."""

import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser_for_tests import found_in

from pcdbench import PointCloud
from pcdbench.viewing.page import view

STEPS = """
  const canvas = canvases()[0];
  const timed = (step) => {
    const times = [];
    for (let i = 0; i < 12; i++) {
      const before = performance.now();
      step();
      canvas.getContext("2d").getImageData(0, 0, 1, 1);
      times.push(performance.now() - before);
    }
    return times.slice(2);
  };
  const whole = timed(() => slide("size", 0)), moving = timed(() => press(canvas, "ArrowLeft"));
  const gl = document.createElement("canvas").getContext("webgl2");
  const known = gl.getExtension("WEBGL_debug_renderer_info");
  return { whole, moving, by: gl.getParameter(known.UNMASKED_RENDERER_WEBGL), pixels: canvas.width * canvas.height };
"""


def box_room(count: int) -> PointCloud:
    """Random points on the six sides of a room of 6 by 5 by 3 m, with random colours."""
    rng = np.random.default_rng(0)
    points = rng.random((count, 3))
    points[np.arange(count), rng.integers(3, size=count)] = rng.integers(2, size=count)
    return PointCloud(points * [6, 5, 3], rng.random((count, 3)))


if __name__ == "__main__":
    count, *size = [int(text) for text in sys.argv[1:]] or [200_000]
    page = view(box_room(count), points=count)
    with tempfile.TemporaryDirectory() as folder:
        found = found_in(page.html, STEPS, Path(folder), tuple(size) or (900, 700))
    print(f"{count:,} points, {len(page.html) / 1e6:.1f} MB, {found['pixels']:,} pixels, {found['by']}")
    for name in ("whole", "moving"):
        times = found[name]
        print(f"{name}: median {statistics.median(times):.0f} ms a frame, {min(times):.0f} to {max(times):.0f} ms")

"""How long a large board's page takes in a browser: `python docs/measure_board_page.py [COMPLETERS SCENES]`."""

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "leaderboard"))
from boards_for_tests import made_board
from browser_for_tests import found_in

from pcdbench.leaderboard.page import board_page

STEPS = """
  const found = { "opening the page": performance.now() };
  const timed = (name, act) => {
    const times = [];
    for (let i = 0; i < 5; i++) {
      const before = performance.now();
      act(i);
      document.body.offsetHeight;
      times.push(performance.now() - before);
    }
    found[name] = times.sort((a, b) => a - b)[2];
  };
  const nth = (selector, i) => { const all = document.querySelectorAll(selector); all[i % all.length].click(); };
  timed("another task", (i) => nth("input[name='task']", 1 + (i % 3)));
  timed("another level", (i) => nth("input[name='level']", i));
  timed("sorting", (i) => nth("[data-sort]", i));
  timed("hiding a completer", (i) => nth("[data-toggles]", 3 + i));
  timed("rows of a number", (i) => {
    document.querySelector("dialog").close();
    nth("tbody.methods .value .number", i);
  });
  timed("one row", (i) => nth(".line-head", i));
  return found;
"""

completers, scenes = map(int, sys.argv[1:3] or (17, 300))
board = made_board([f"completer {i}" for i in range(completers)], [f"room {i}" for i in range(scenes)])
before = time.process_time()
page = board_page(board, case_command="pcdbench leaderboard case leaderboards/rooms")
print(f"{completers + 3} completers, {len(board.cases)} cases: {len(page) / 1e6:.1f} MB, ", end="")
print(f"written in {time.process_time() - before:.1f} s of processor time")
with tempfile.TemporaryDirectory() as folder:
    for name, milliseconds in found_in(page, STEPS, Path(folder), (1280, 900)).items():
        print(f"{name}: {milliseconds:.0f} ms")

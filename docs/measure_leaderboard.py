"""What building a large board costs: `python docs/measure_leaderboard.py [SCENES LEVELS COMPLETERS]`, five tasks.

Rows are made up, with as many samples and as much to draw as those of the built-in tasks. Prints processor time,
peak memory and what is written.
"""

import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from pcdbench.keys import digest

# Task: its metrics, each with its number of samples a case; and the bytes of its trace.
TASKS = {
    "chamfer": ({"chd": 1, "accuracy_m": 1, "completeness_m": 1, "f_score": 1, "hole_chd": 1}, 2),
    "ssim": ({"ssim": 1}, 2),
    "localization": ({"error_m": 10, "planar_m": 10, "rotation_deg": 10, "success": 10}, 600),
    "tracking": ({"error_m": 30, "rotation_deg": 30, "relative_m": 30, "drift_m": 1}, 1600),
    "tagging": ({"failure_rate": 20, "object_ssim": 20}, 2),
}


def write_run(folder: Path, scenes: int, levels: int, completers: int) -> int:
    """A run of made-up rows in `folder`; how many rows it has."""
    rng = np.random.default_rng(0)
    dataset = {"name": "rooms", "version": "1", "options": {}}
    methods = [f"completer{number}" for number in range(completers)]
    configuration = {"split": "test", "seed": 0, "completers": []}
    (folder / "run.json").write_text(json.dumps({"schema_version": 1, "configuration": configuration, "time": "now"}))
    count = 0
    with (folder / "rows.jsonl").open("w") as stream:
        for scene in range(scenes):
            base = rng.gamma(2.0)
            for level in range(1, levels + 1):
                for number, completer in enumerate(methods):
                    cell = digest([scene, level, completer])
                    for task, (metrics, trace) in TASKS.items():
                        measured = {
                            name: {
                                "unit": "m",
                                "direction": "lower",
                                "summary": "mean",
                                "main": name == next(iter(metrics)),
                                "samples": [
                                    float(f"{value:.9g}")
                                    for value in base * level * rng.lognormal(0.02 * number, 0.2, size)
                                ],
                            }
                            for name, size in metrics.items()
                        }
                        row = {
                            "schema_version": 1,
                            "key": digest([cell, task]),
                            "cell": cell,
                            "dataset": dataset | {"digest": str(scene)},
                            "scene": f"room{scene}",
                            "draw": 0,
                            "incompleteness": {"name": "holes", "version": "1", "options": {}},
                            "level": level / 10,
                            "seed": scene,
                            "completer": {
                                "name": completer,
                                "version": "1",
                                "options": {},
                                "weights": None,
                                "reference": number == 0,
                            },
                            "task": {"name": task, "version": "1", "options": {}},
                            "status": "ok",
                            "stage": None,
                            "error": None,
                            "detail": None,
                            "metrics": measured,
                            "trace": {"drawn": "x" * trace},
                            "missing": level / 10,
                            "completing": {"seconds": 1.0 + number, "peak_memory_mb": 10.0, "cached": False},
                            "time": "now",
                            "host": "here",
                        }
                        stream.write(json.dumps(row) + "\n")
                        count += 1
    return count


def main() -> None:
    scenes, levels, completers = map(int, sys.argv[1:4]) if sys.argv[1:] else (300, 3, 10)
    with tempfile.TemporaryDirectory() as scratch:
        run, out = Path(scratch, "run"), Path(scratch, "board")
        run.mkdir()
        rows = write_run(run, scenes, levels, completers)
        size = (run / "rows.jsonl").stat().st_size / 1e6
        print(f"{rows} rows, {size:.0f} MB; {_peak_mb():.0f} MB of memory before")
        start = time.process_time()

        from pcdbench.leaderboard.building import board_of_runs
        from pcdbench.leaderboard.publishing import publish

        board = board_of_runs("rooms", [run])
        built = time.process_time()
        publish(board, out)
        print(f"built in {built - start:.1f} s, written in {time.process_time() - built:.1f} s of processor time")
        print(f"{_peak_mb():.0f} MB of memory at most")
        for path in sorted(path for path in out.rglob("*") if path.is_file()):
            print(f"{path.relative_to(out)}: {path.stat().st_size / 1e6:.2f} MB")


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


if __name__ == "__main__":
    main()

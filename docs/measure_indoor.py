"""How long the first crop of an environment takes, nothing cached: `python docs/measure_indoor.py [FIRST [LAST]]`.

Makes the first crop of every one of the fifty environments (or of FIRST to LAST) in one process, as `pcdbench run`
does: building, furnishing, surveying, writing to an empty cache. Prints seconds and processor seconds of each, then
the median and the largest of each kind. About two minutes on two cores.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time

from pcdbench.datasets.synthetic import Indoor
from pcdbench.open3d_loader import load_open3d
from pcdbench.threads import thread_count


def main(first: int = 0, last: int = 49) -> None:
    start = time.perf_counter()
    load_open3d()
    print(f"{thread_count()} threads; importing open3d once took {time.perf_counter() - start:.1f} s\n")
    print("| environment | kind | seconds | processor seconds |\n|---|---|---|---|")
    of_kind: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as cache:
        os.environ["PCDBENCH_CACHE"] = cache
        for index in range(first, last + 1):
            seconds, busy = time.perf_counter(), time.process_time()
            scene = Indoor().scene(f"env{index:03d}_crop0")
            seconds, busy = time.perf_counter() - seconds, time.process_time() - busy
            of_kind.setdefault(scene.info["kind"], []).append(seconds)
            print(f"| {index} | {scene.info['kind']} | {seconds:.2f} | {busy:.2f} |", flush=True)
    print("\n| kind | environments | median, s | largest, s |\n|---|---|---|---|")
    for kind, times in sorted(of_kind.items(), key=lambda item: -max(item[1])):
        print(f"| `{kind}` | {len(times)} | {statistics.median(times):.2f} | {max(times):.2f} |")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

"""Registration in a worker uses one thread and gives the same bits each time."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

PROGRAM = """
import json, os, sys
from pcdbench.threads import limit_threads
limit_threads(int(sys.argv[1]))
import numpy as np
from pcdbench.geometry.registration import register
from pcdbench.open3d_loader import load_open3d
from pcdbench.testing import small_room
points = small_room(3000).dense.points
load_open3d()
before = len(os.listdir("/proc/self/task"))
found = register(points[::2] + [0.05, 0.02, 0.0], points[1::2], np.eye(4), "ndt", (1.0, 0.5))
print(json.dumps([before, len(os.listdir("/proc/self/task")), len(os.sched_getaffinity(0)), found.tobytes().hex()]))
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system cannot say which processors are used")
def test_workers_register_with_one_thread_and_to_the_same_bits() -> None:
    answers = []
    for threads in "12":
        done = subprocess.run([sys.executable, "-c", PROGRAM, threads], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        answers.append(json.loads(done.stdout.splitlines()[-1]))
    for before, after, processors, _ in answers:
        assert after == before, "no threads of TBB are started"
        assert processors == len(os.sched_getaffinity(0)), "all processors may be used again"
    assert answers[0][3] == answers[1][3]

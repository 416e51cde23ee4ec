"""How every worker process begins: with its share of threads, silent on standard output, gone with its parent.

Nothing heavy is imported here: threads are limited before numpy is first imported.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from multiprocessing.process import BaseProcess

from pcdbench.threads import limit_threads


def begin_worker(threads: int) -> None:
    """Set up this process, a spawned worker, before it does anything else."""
    limit_threads(threads)
    # Native libraries print to standard output, where the parent's tables and JSON go.
    os.dup2(2, 1)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    """End this process when its parent is gone, killed even."""
    parent.join()
    os._exit(1)

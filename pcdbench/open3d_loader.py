"""The one place that imports Open3D: it needs libusb, which a bare system does not have.

The package `libusb-package` carries the library; loading it globally before Open3D is enough, so that
`pip install` alone works, without any system package.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
from collections.abc import Iterator
from functools import cache
from typing import Any

from pcdbench.errors import PcdbenchError
from pcdbench.threads import threads_are_limited


@cache
def load_open3d() -> Any:
    """The module `open3d`, quiet but for errors.

    Raises:
        PcdbenchError: where it cannot be imported, with its reason.
    """
    import libusb_package

    library = libusb_package.get_library_path()
    if library is not None:
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    logging.getLogger("dash").setLevel(logging.ERROR)
    try:
        with _seeing_one_processor():
            import open3d
    except ImportError as error:
        raise PcdbenchError(
            f"open3d cannot be imported ({error}); reinstall it: pip install --force-reinstall open3d"
        ) from error
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


@contextlib.contextmanager
def _seeing_one_processor() -> Iterator[None]:
    """In a worker, TBB gets one thread.

    Registration adds up in TBB's threads, in another order each time, and its last digits differ. TBB heeds no
    variable: it counts the processors that it may use when Open3D is imported.
    """
    if not (threads_are_limited() and hasattr(os, "sched_setaffinity")):
        yield
        return
    allowed = os.sched_getaffinity(0)
    # Workers that begin together should not meet on one.
    os.sched_setaffinity(0, {sorted(allowed)[os.getpid() % len(allowed)]})
    try:
        yield
    finally:
        # Threads that were started meanwhile, too.
        for thread in os.listdir("/proc/self/task"):
            with contextlib.suppress(ProcessLookupError):
                os.sched_setaffinity(int(thread), allowed)

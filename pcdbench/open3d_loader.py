"""The one place that imports Open3D: it needs libusb, which a bare system does not have.

The package `libusb-package` carries the library; loading it globally before Open3D is enough, so that
`pip install` alone works, without any system package.
"""

from __future__ import annotations

import ctypes
import logging
from functools import cache
from typing import Any

from pcdbench.errors import PcdbenchError


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
        import open3d
    except ImportError as error:
        raise PcdbenchError(
            f"open3d cannot be imported ({error}); reinstall it: pip install --force-reinstall open3d"
        ) from error
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d

"""pcdbench measures how much completing an indoor point cloud helps what you want to do with it.

The names below are the public API. They and all modules are imported on first use: `import pcdbench` costs nothing.
"""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING, Any

from pcdbench.errors import CloudError, PcdbenchError, PluginError, Skipped

if TYPE_CHECKING:
    from pcdbench.case import Case, make_case
    from pcdbench.cloud import PointCloud
    from pcdbench.completer import Completer, ReferenceCompleter
    from pcdbench.completion import Completed, complete
    from pcdbench.dataset import Dataset, Finding
    from pcdbench.external import CommandCompleter, FolderCompleter
    from pcdbench.incompleteness import Incompleteness
    from pcdbench.leaderboard.results import read_figures, read_results
    from pcdbench.options import Options
    from pcdbench.plugins import Register, hookimpl
    from pcdbench.scene import Box, Scene, Surface, TaggedObject
    from pcdbench.task import Measurements, Metric, Task
    from pcdbench.viewing.page import view

__version__ = "0.1.0"

_MODULE_OF_NAME = {
    "Box": "scene",
    "Case": "case",
    "CommandCompleter": "external",
    "Completed": "completion",
    "Completer": "completer",
    "Dataset": "dataset",
    "Finding": "dataset",
    "FolderCompleter": "external",
    "Incompleteness": "incompleteness",
    "Measurements": "task",
    "Metric": "task",
    "Options": "options",
    "PointCloud": "cloud",
    "ReferenceCompleter": "completer",
    "Register": "plugins",
    "Scene": "scene",
    "Surface": "scene",
    "TaggedObject": "scene",
    "Task": "task",
    "complete": "completion",
    "hookimpl": "plugins",
    "make_case": "case",
    "read_figures": "leaderboard.results",
    "read_results": "leaderboard.results",
    "view": "viewing.page",
}

__all__ = [
    "Box",
    "Case",
    "CloudError",
    "CommandCompleter",
    "Completed",
    "Completer",
    "Dataset",
    "Finding",
    "FolderCompleter",
    "Incompleteness",
    "Measurements",
    "Metric",
    "Options",
    "PcdbenchError",
    "PluginError",
    "PointCloud",
    "ReferenceCompleter",
    "Register",
    "Scene",
    "Skipped",
    "Surface",
    "TaggedObject",
    "Task",
    "complete",
    "hookimpl",
    "make_case",
    "read_figures",
    "read_results",
    "view",
]


def __getattr__(name: str) -> Any:
    if name in _MODULE_OF_NAME:
        return getattr(importlib.import_module(f"pcdbench.{_MODULE_OF_NAME[name]}"), name)
    if not name.startswith("_") and importlib.util.find_spec(f"pcdbench.{name}"):
        return importlib.import_module(f"pcdbench.{name}")
    raise AttributeError(f"module 'pcdbench' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)

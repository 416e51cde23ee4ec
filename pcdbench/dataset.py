"""The contract of a data set: a named, versioned, splittable source of scenes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from pcdbench import options as plugin_options
from pcdbench.scene import Scene


class Dataset(ABC):
    """A source of scenes. Subclass it, list its splits, make a scene by name.

    Attributes:
        Options: the model of its options; `self.options` is an instance.
        version: raise it whenever a scene changes; results of other versions do not mix.
        default_split: taken where the user names none.
    """

    Options: ClassVar[type[plugin_options.Options]] = plugin_options.Options
    options: plugin_options.Options
    version: ClassVar[str] = "1"
    default_split: ClassVar[str] = "test"

    def __init__(self, path: Path | None = None, options: plugin_options.Options | None = None) -> None:
        """Open the data set; `path` is what follows the colon in `--dataset NAME:PATH`."""
        self.path = path
        self.options = self.Options() if options is None else options

    @abstractmethod
    def splits(self) -> Sequence[str]:
        """The names of its splits."""

    @abstractmethod
    def scene_names(self, split: str) -> Sequence[str]:
        """The scenes of a split, in a fixed order, without making them.

        Raises:
            PcdbenchError: for a split it does not have.
        """

    @abstractmethod
    def scene(self, name: str) -> Scene:
        """Make or read one scene.

        Raises:
            PcdbenchError: naming what is wrong with it (a file that cannot be read, say).
        """

    def draws(self, split: str) -> int:
        """How many cases, each of another seed, a scene of this split gives at each level."""
        return 1

    @abstractmethod
    def digest(self, name: str) -> str:
        """What decides the content of a scene beside the version (a file's SHA-256, a generator's seed)."""

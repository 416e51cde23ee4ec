"""The contract of a data set: a named, versioned, splittable source of scenes."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from pcdbench import options as plugin_options
from pcdbench.errors import PcdbenchError
from pcdbench.scene import Scene


@dataclass(frozen=True)
class Finding:
    """Something that is not as it should be in the files of a scene.

    Attributes:
        where: the file, with its line where there is one (`chair_1.txt:12`).
        problem: what is wrong.
        done: what was done about it.
        usable: False where the scene cannot be used because of it.
    """

    where: str
    problem: str
    done: str = ""
    usable: bool = True

    def __str__(self) -> str:
        return f"{self.where}: {self.problem}" + (f"; {self.done}" if self.done else "")


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

    def environment(self, name: str) -> str:
        """What a scene is a part of: scenes of one environment have surface in common, and do not count as independent.

        Intervals and ranks are over environments. Unless overridden, each scene is one of its own.
        """
        return name

    @abstractmethod
    def digest(self, name: str) -> str:
        """What decides the content of a scene beside the version (a file's SHA-256, a generator's seed)."""

    def check(self, name: str) -> Sequence[Finding]:
        """What is wrong with a scene, and what was done about it; nothing is raised for a scene that is broken.

        Unless overridden, the scene is opened: an error makes it unusable, a warning is a finding.
        """
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                scene = self.scene(name)
            except PcdbenchError as error:
                return [Finding(name, str(error), usable=False)]
        told = dict.fromkeys(str(its.message) for its in warned if issubclass(its.category, UserWarning))
        findings = [Finding(name, problem) for problem in told]
        if not _is_drawn(scene):
            findings.append(
                Finding(
                    name,
                    "its complete_index does not name the rows of its dense cloud that make up its complete cloud",
                    "the reference resample, which draws from the other rows, is no ceiling",
                )
            )
        if scene.dense.colors is None:
            findings.append(Finding(name, "it has no colour", "what needs colour is skipped"))
        return findings


def _is_drawn(scene: Scene) -> bool:
    """Whether the complete cloud is those rows of the dense one that the scene names."""
    rows = np.asarray(scene.complete_index)
    inside = rows.shape == (len(scene.complete),) and rows.min() >= 0 and rows.max() < len(scene.dense)
    return inside and np.array_equal(scene.dense.points[rows], scene.complete.points)

"""The contract of a completer: it turns an incomplete cloud into a complete one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from pcdbench import options as plugin_options
from pcdbench.cloud import PointCloud

if TYPE_CHECKING:
    from pcdbench.case import Case


class Completer(ABC):
    """Turns an incomplete cloud into a complete one. Subclass it, set what it is, write `complete`.

    One instance serves many clouds, one after the other; build what is costly (a network, say) in
    `__init__`. A completer never sees the complete cloud.

    Attributes:
        Options: the model of its options; `self.options` is an instance.
        version: raise it whenever the output changes; results of other versions are not reused.
        needs_color: cases without colour are skipped, with that as the reason.
        citation: whom to cite.
        trainee: for a completer that learns, its `pcdbench.training.trainee.Trainee` as "package.module:Class".
        costs: what rows say of what completing cost. One that has others work for it leaves out what they spent unseen.
    """

    Options: ClassVar[type[plugin_options.Options]] = plugin_options.Options
    options: plugin_options.Options
    version: ClassVar[str] = "1"
    needs_color: ClassVar[bool] = False
    citation: ClassVar[str] = ""
    trainee: ClassVar[str | None] = None
    costs: ClassVar[tuple[Literal["seconds", "peak_memory_mb"], ...]] = ("seconds", "peak_memory_mb")

    def __init__(self, options: plugin_options.Options | None = None) -> None:
        self.options = self.Options() if options is None else options

    @abstractmethod
    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """The completed cloud, in the frame and unit (metres) of `cloud`.

        Args:
            cloud: what is left of a scan: never empty, metres, z up, colours or none.
            rng: the only source of randomness; it is seeded from the cell's key, so that the same cell
                gives the same cloud whatever ran before it.
        """

    def complete_with_confidence(
        self, cloud: PointCloud, rng: np.random.Generator
    ) -> tuple[PointCloud, NDArray[np.floating[Any]] | None]:
        """What `complete` returns, and how sure the completer is of each point of it, where it can say.

        `pcdbench.complete` asks this way. Override it where the method knows its certainty, and let `complete`
        return the first of the two.

        Returns:
            The completed cloud, and (N,) in [0, 1] for each of its points, best the probability that there is
            surface about there; what it says of points of the input is not looked at. None where it cannot say.
        """
        return self.complete(cloud, rng), None

    def weights_digest(self) -> str | None:
        """SHA-256 of the weights in use, or None for a completer that learned nothing."""
        return None

    def model_card(self) -> Mapping[str, Any] | None:
        """What made the weights in use, as JSON values, or None for a completer that learned nothing.

        Leaderboards read `trained_on` of it: a list of what was seen in training, each a `dataset` (its name) and,
        where that was not all of it, a `split` or `scenes` (names of scenes, or of environments, which begin the
        names of theirs). A completer that saw a board's test scenes is flagged there; what is of another shape, or
        names a split that the data set does not have, is refused before anything runs.
        """
        return None


class ReferenceCompleter(Completer):
    """A row to measure against, not a method: it may look at the complete cloud. Never ranked."""

    @abstractmethod
    def answer(self, case: Case, rng: np.random.Generator) -> PointCloud:
        """The cloud that this reference stands for."""

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """A reference needs the case, not the cloud alone."""
        raise NotImplementedError(f"{type(self).__name__} is a reference: it answers cases, not clouds")

"""The contract of a completer that learns: its network, its examples, its loss, and how it is trained."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from pcdbench.completer import Completer
from pcdbench.errors import PcdbenchError, PluginError, told
from pcdbench.options import Options
from pcdbench.plugins import load_target
from pcdbench.training.stream import TrainingPair

if TYPE_CHECKING:
    from torch import Tensor, nn

Example = dict[str, NDArray]


@dataclass(frozen=True)
class Preset:
    """How the optimizer goes about it.

    Attributes:
        learning_rate: the full one; schedules lower it.
        batch: fresh examples a step (each process of several takes as many).
        schedule: `cosine` warms up and falls to 1 % as the budget is spent; `plateau` divides by ten when the
            validation error has not fallen for two checks.
        weight_decay: decoupled (AdamW); 0 is plain Adam.
        steps: the length where the user gives none.
        validate_every: steps between two checks of the validation error; None leaves it to the clock.
    """

    learning_rate: float = 1e-3
    batch: int = 2
    schedule: Literal["cosine", "plateau"] = "cosine"
    weight_decay: float = 1e-4
    steps: int | None = None
    validate_every: int | None = None


class Trainee(ABC):
    """What `pcdbench train` needs to know of a completer; the completer's class names it as `trainee`.

    All randomness of training is in the examples, so that a resumed training goes on bit by bit; a loss draws none.

    Attributes:
        presets: how it can be trained, by name; `default` fits hours on two cores.
    """

    presets: ClassVar[Mapping[str, Preset]] = {"default": Preset()}

    @classmethod
    def for_options(cls, options: Options) -> Trainee:
        """The trainee for these options; override it where they change network, examples or validation."""
        return cls()

    @abstractmethod
    def network(self) -> nn.Module:
        """The network, freshly initialised."""

    @abstractmethod
    def example(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
        """Everything that depends on the pair alone, as arrays: made in loader workers, never by the network."""

    def collate(self, examples: Sequence[Example]) -> list[Example]:
        """The examples of a step as the network takes them: one after the other, unless it takes several at once."""
        return list(examples)

    @abstractmethod
    def loss(self, network: nn.Module, example: dict[str, Tensor]) -> dict[str, Tensor]:
        """The terms of one example's loss, by name; `loss` is what is minimised, in float32.

        The network is to be called once and as a whole: with several devices it is wrapped.
        """

    def parameter_groups(self, network: nn.Module) -> Iterable[dict[str, Any]]:
        """The optimizer's groups: each its `params` and, where it differs, `rate`, a factor on the learning rate."""
        return [{"params": list(network.parameters())}]

    def completes(self, tensor: str) -> bool:
        """Whether completing needs this tensor; what only training needs is left out of the weights."""
        return True

    @abstractmethod
    def completer(self, network: nn.Module) -> Completer:
        """A completer that uses this network, for validation."""


def load_trainee(name: str, target: str, options: Options) -> Trainee:
    """The trainee that a completer's class names, for these options.

    Args:
        name: of the completer or its part, for messages.
        target: where it is, as "package.module:Class".

    Raises:
        PluginError: where it cannot be imported or built, or is no `Trainee`.
        PcdbenchError: what it raises of this kind itself.
    """
    try:
        trainee: Any = load_target(target).for_options(options)
    except PcdbenchError:
        raise
    except Exception as error:
        raise PluginError(
            f"{name} cannot be trained: its class names the trainee {target!r}: {told(error)}; "
            'it must be "package.module:Class", a complete pcdbench.training.trainee.Trainee'
        ) from error
    if not isinstance(trainee, Trainee):
        raise PluginError(
            f"{name} cannot be trained: the trainee {target!r} gave {type(trainee).__name__}, "
            "not a pcdbench.training.trainee.Trainee"
        )
    return trainee

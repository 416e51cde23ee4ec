"""Weights of learned completers: safetensors with a model card beside them; nothing is ever unpickled."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pcdbench.completer import Completer
from pcdbench.downloads import downloaded, is_address
from pcdbench.errors import PcdbenchError
from pcdbench.keys import digest, file_digest
from pcdbench.options import Options

CARD_SUFFIX = ".card.json"


class Weights:
    """The weights file of a completer, the one in its package or the user's own, and its model card.

    Attributes:
        path: the safetensors file.
        digest: SHA-256 (hex) of its bytes.
        card: the facts in `<stem>.card.json` beside it (see `pcdbench.training.card`); None where one's own
            weights have none.
    """

    def __init__(self, shipped: Path, own: str, name: str) -> None:
        """Find the weights and check them against their card.

        Args:
            shipped: where the package has them.
            own: a file to use instead, on disk or at `PROTOCOL://...#sha256=DIGEST` (see `downloads`); empty for none.
            name: of the completer, or of its part (`deeppcd.color`), for messages.

        Raises:
            PcdbenchError: where the file is missing, or is not the one that its card or its digest describes.
        """
        # Shells leave the `~` of NAME.weights=~/FILE to whoever reads it.
        self.path = downloaded(own) if is_address(own) else Path(os.path.expanduser(own)) if own else shipped
        self._name = name
        if not os.path.isfile(self.path):
            cure = (
                "check the path"
                if own
                else f"train them (pcdbench train {name} --hours 1 --out DIR) and give them with "
                f"--option {weights_option(name)}=DIR/weights.safetensors"
            )
            raise PcdbenchError(f"the weights of {name} are not at {self.path}; {cure}")
        self.digest = file_digest(self.path)
        self.card = model_card(self.path)
        if self.card is None and not own:
            raise PcdbenchError(f"the weights of {name} have no model card beside {self.path}; reinstall pcdbench")
        if self.card is not None and self.card.get("sha256") != self.digest:
            raise PcdbenchError(
                f"{self.path} is not the file that its model card describes; "
                + ("get both again" if own else "reinstall pcdbench")
            )

    def tensors(self) -> dict[str, Any]:
        """The tensors by name, in float32.

        Raises:
            PcdbenchError: where the file is not safetensors, or holds what is no number.
        """
        import torch
        from safetensors import SafetensorError
        from safetensors.torch import load_file

        try:
            loaded = load_file(self.path)
        except SafetensorError as error:
            raise PcdbenchError(f"{self.path} does not hold weights ({error}); give a safetensors file") from error
        for key, value in loaded.items():
            if not bool(torch.isfinite(value).all()):
                raise PcdbenchError(f"{self.path} holds infinite or undefined numbers ({key}); train it again")
        return {key: value.float() if value.is_floating_point() else value for key, value in loaded.items()}

    def origin(self) -> dict[str, Any]:
        """What a card tells of the weights that a training began from: their digest and what made them."""
        card = self.card or {}
        told = ("trained_on", "seed", "steps", "pairs", "hours", "begun_from", "date")
        return {"sha256": self.digest} | {key: card[key] for key in told if key in card}

    def load_into(self, network: Any) -> Any:
        """The `torch.nn.Module` with these weights, in evaluation mode; raises as `begin` does."""
        self.begin(network)
        return network.eval()

    def begin(self, network: Any, needed: Callable[[str], bool] = lambda _: True) -> None:
        """Give the `torch.nn.Module` these weights; whether it is training does not change.

        Args:
            needed: whether the file must hold this tensor; the network keeps its own where it need not and does not.

        Raises:
            PcdbenchError: where the file is not safetensors, or holds another network.
        """
        try:
            tensors = self.tensors()
            own = {name: value for name, value in network.state_dict().items() if not needed(name)}
            network.load_state_dict(own | tensors)
        except RuntimeError as error:
            first = str(error).strip().splitlines()[-1].strip()
            raise PcdbenchError(
                f"{self.path} holds the weights of another network than {self._name} ({first})"
            ) from None


class LearnedCompleter(Completer):
    """A completer with networks that learned: what is known of the weights in use."""

    def __init__(self, options: Options | None = None) -> None:
        super().__init__(options)
        self._weights: list[Weights] = []

    def trained(self, network: Any, shipped: Path, own: str, name: str) -> Any:
        """The `torch.nn.Module` with its weights, which count from now on as this completer's; its main network first.

        See `Weights` for the arguments and for what is raised.
        """
        self._weights.append(Weights(shipped, own, name))
        return self._weights[-1].load_into(network)

    def weights_digest(self) -> str | None:
        digests = [weights.digest for weights in self._weights]
        return digest(digests) if len(digests) > 1 else next(iter(digests), None)

    def weights_files(self) -> list[Path]:
        """The files in use, that of the main network first."""
        return [weights.path for weights in self._weights]

    def model_card(self) -> Mapping[str, Any] | None:
        """That of the main network."""
        return self._weights[0].card if self._weights else None


def weights_option(name: str) -> str:
    """The option for weights of one's own: `NAME.weights` of a completer, `NAME.PART_weights` of its part."""
    completer, _, part = name.partition(".")
    return f"{completer}.{part}_weights" if part else f"{completer}.weights"


def model_card(weights: Path) -> Mapping[str, Any] | None:
    """The model card beside a weights file, or None where there is none.

    Raises:
        PcdbenchError: where it cannot be read.
    """
    path = weights.with_suffix(CARD_SUFFIX)
    if not path.is_file():
        return None
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise PcdbenchError(f"the model card {path} cannot be read ({error}); get it again") from None
    if not isinstance(card, dict):
        raise PcdbenchError(f"the model card {path} holds no JSON object; get it again")
    return card

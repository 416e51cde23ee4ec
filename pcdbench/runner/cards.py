"""What a completer says of its weights, checked before anything is run by it: boards read it long after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from pydantic import BaseModel, ValidationError

from pcdbench.errors import PcdbenchError, PluginError, first_problem
from pcdbench.keys import canonical_json
from pcdbench.plugins import did_you_mean, registry


class _Seen(BaseModel):
    dataset: str
    split: str = ""
    scenes: list[str] = []


class CardShape(BaseModel):
    """What boards read of a model card."""

    trained_on: list[_Seen] = []


class _Begun(CardShape):
    begun_from: _Begun | None = None


def seen_along(card: Mapping[str, Any], where: str) -> list[dict[str, Any]]:
    """What is in `trained_on` of a card and of the weights that these were begun from, each entry once.

    Args:
        where: whose card it is, for messages.

    Raises:
        PcdbenchError: where one of them is not as `Completer.model_card` says.
    """
    try:
        _Begun.model_validate(card)
    except ValidationError as error:
        raise PcdbenchError(
            f"the model card of {where} does not say what the weights were trained on ({first_problem(error)}); "
            'its trained_on is a list of {"dataset": NAME}, each with a "split", a list of "scenes", or neither'
        ) from None
    seen: list[dict[str, Any]] = []
    at: Mapping[str, Any] | None = card
    while at is not None:
        seen += [entry for entry in at.get("trained_on", ()) if entry not in seen]
        at = at.get("begun_from")
    return seen


def checked_card(name: str, card: Any) -> dict[str, Any] | None:
    """The model card that the completer `name` gave, as rows and boards can have it.

    Raises:
        PluginError: where it is none, or its `trained_on` is not as `Completer.model_card` says.
    """
    if card is None:
        return None
    if not isinstance(card, Mapping):
        raise PluginError(f"completer {name!r}: model_card() must return a mapping or None, not {type(card).__name__}")
    told = dict(card)
    try:
        canonical_json(told)
    except (TypeError, ValueError, RecursionError) as error:
        raise PluginError(f"completer {name!r}: model_card() must hold JSON values alone ({error})") from None
    try:
        CardShape.model_validate(told)
    except ValidationError as error:
        raise PluginError(
            f"completer {name!r}: model_card() has another trained_on ({first_problem(error)}); it is a list of "
            '{"dataset": NAME}, each with a "split", a list of "scenes", or neither'
        ) from None
    return told


def require_known_splits(name: str, card: Mapping[str, Any] | None) -> None:
    """Refuse a card that names a split which its data set does not have: boards would find no scene of it.

    Only of data sets that are generated is it known; the splits of others depend on what lies on this machine.

    Raises:
        PluginError: naming the completer and the split.
    """
    for seen in (card or {}).get("trained_on", ()):
        split = seen.get("split", "")
        splits = _splits(seen["dataset"]) if split else ()
        if splits and split not in splits:
            raise PluginError(
                f"completer {name!r}: model_card() names the split {split!r}, which {seen['dataset']} does not have; "
                f"{did_you_mean(split, splits)}"
            )


@cache
def _splits(dataset: str) -> Sequence[str]:
    try:
        registration = registry().get("dataset", dataset)
        return () if registration.path else tuple(registration.load()().splits())
    except (Exception, SystemExit):
        # It is not installed, or is another's and raises what it likes.
        return ()

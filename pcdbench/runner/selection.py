"""What a user named, resolved: plugins with their options checked, versions known and digests taken."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from pcdbench.downloads import downloaded, is_address
from pcdbench.errors import PcdbenchError, PluginError, problem_text, told
from pcdbench.keys import canonical_json, digest, file_digest
from pcdbench.plugins import KINDS, Kind, did_you_mean, registry
from pcdbench.runner.cards import checked_card

OptionsModel = TypeVar("OptionsModel", bound=BaseModel)

_SEQUENCES = (list, tuple, set, frozenset, Sequence)


@dataclass(frozen=True)
class Plugin:
    """One plugin of a run: everything about it that decides outcomes, small enough to send to a worker.

    Attributes:
        options: all its options, those left at their default too, as JSON values.
        weights: digest of a completer's weights, or None.
        code: digest of the file its class is in. Development changes code without raising a version: then
            completions cached before are not reused, and an old run is not taken up again.
        path: what follows the colon in `--dataset NAME:PATH`; where data lies decides no outcome. An address with a
            digest (see `downloads`) is fetched by each machine that builds the data set.
        has_levels: of an incompleteness: whether `--level` applies.
        card: a completer's model card, or None.
    """

    kind: Kind
    name: str
    version: str
    options: Mapping[str, Any]
    reference: bool = False
    weights: str | None = None
    code: str = ""
    path: str | None = None
    has_levels: bool = True
    card: Mapping[str, Any] | None = None

    def describe(self) -> dict[str, Any]:
        """What a result row says about it."""
        shown: dict[str, Any] = {"name": self.name, "version": self.version, "options": dict(self.options)}
        if self.kind == "completer":
            shown |= {"reference": self.reference, "weights": self.weights}
        return shown

    @cached_property
    def identity(self) -> str:
        """Digest of name, version, options and weights: what of it decides an outcome."""
        return digest([self.kind, self.name, self.version, dict(self.options), self.weights])

    def code_here(self) -> str:
        """Digest of the code that is loaded under its name where this is called; see `code`."""
        return code_digest(registry().get(self.kind, self.name).load())

    def build(self) -> Any:
        """A new instance of the plugin's class, with these options."""
        cls = registry().get(self.kind, self.name).load()
        options = cls.Options.model_validate(self.options)
        if self.kind == "dataset":
            return cls(None if self.path is None else _path(self.path), options)
        return cls(options)


def parse_options(texts: Sequence[str]) -> dict[str, dict[str, str]]:
    """`NAME.KEY=VALUE` texts as {name: {key: value}}.

    Raises:
        PcdbenchError: for a text of another shape, or a key with two values.
    """
    options: dict[str, dict[str, str]] = {}
    for text in texts:
        left, equals, value = text.partition("=")
        name, dot, key = left.partition(".")
        if not (equals and dot and name and key):
            raise PcdbenchError(f"--option {text!r} must look like NAME.KEY=VALUE (plane_fitting.distance_m=0.02)")
        its, key, value = options.setdefault(name.strip(), {}), key.strip(), value.strip()
        if its.setdefault(key, value) != value:
            raise PcdbenchError(f"--option {name.strip()}.{key} is given twice, as {its[key]} and as {value}; give one")
    return options


def select(kind: Kind, name: str, options: Mapping[str, str], *, path: str | None = None) -> Plugin:
    """The plugin of this name with these options.

    Raises:
        PluginError: where there is none, it cannot be loaded or it breaks its contract.
        PcdbenchError: for an option it does not have or a value it does not take.
    """
    model = registry().get(kind, name).load().Options
    return select_recorded(kind, name, _recorded(name, checked_options(name, model, options)), path=path)


def select_recorded(kind: Kind, name: str, options: Mapping[str, Any], *, path: str | None = None) -> Plugin:
    """The plugin of this name with all its options as a row or a board has them, which are not checked.

    Raises:
        PluginError: as `select` does.
        PcdbenchError: where a data set takes no path, or a completer does not have its weights.
    """
    registration = registry().get(kind, name)
    if path is not None and not registration.path:
        raise PcdbenchError(f"data set {name!r} takes no path; leave out :{path}")
    cls = registration.load()
    plugin = Plugin(
        kind=kind,
        name=name,
        version=cls.version,
        options=dict(options),
        reference=registration.reference,
        code=code_digest(cls),
        path=path,
        has_levels=getattr(cls, "has_levels", True),
    )
    return _with_weights(plugin, cls) if kind == "completer" else plugin


def _recorded(name: str, options: BaseModel) -> dict[str, Any]:
    """The options as rows and keys have them."""
    try:
        recorded: dict[str, Any] = _in_order(options.model_dump(), options.model_dump(mode="json"))
        canonical_json(recorded)
    except (TypeError, ValueError) as error:
        # Given values are checked; defaults, and types that pydantic does not know, are the plugin's own.
        raise PluginError(
            f"the options of {name} cannot be recorded as JSON ({error}): its Options must change"
        ) from None
    return recorded


def _in_order(value: Any, recorded: Any) -> Any:
    """What was recorded of a value, its sets in one order; theirs is another one in every process."""
    if isinstance(value, set | frozenset):
        return sorted(recorded, key=canonical_json)
    if isinstance(value, Mapping) and isinstance(recorded, Mapping):
        both = zip(value.values(), recorded.items(), strict=True)
        return {key: _in_order(its, as_json) for its, (key, as_json) in both}
    if isinstance(value, list | tuple) and isinstance(recorded, list):
        return [_in_order(*both) for both in zip(value, recorded, strict=True)]
    return recorded


def option_targets(options: Mapping[str, Mapping[str, str]], names: Mapping[Kind, Sequence[str]]) -> None:
    """Check that every option is for a plugin of the run.

    Raises:
        PcdbenchError: naming the plugins that are in it.
    """
    known = [name for of_kind in names.values() for name in of_kind]
    for name in options:
        if name not in known:
            installed = any(found.name == name for kind in KINDS for found in registry().all(kind))
            cure = f"name it there too, or leave its options out ({', '.join(known)})" if installed else None
            raise PcdbenchError(f"--option {name}.…: {name!r} is not in this run; {cure or did_you_mean(name, known)}")


@contextmanager
def whose_data_set(plugin: Plugin) -> Iterator[None]:
    """Whatever a data set raises within is one line that names it.

    Raises:
        PluginError: in the place of what is not a `PcdbenchError`.
    """
    try:
        yield
    except PcdbenchError:
        raise
    except (Exception, SystemExit) as error:
        lies_somewhere = registry().get("dataset", plugin.name).path and not plugin.path
        cure = f" (--dataset {plugin.name}:PATH says where it lies)" if lies_somewhere else ""
        raise PluginError(f"data set {plugin.name!r} cannot be used: {told(error)}{cure}") from error


def _path(text: str) -> Path:
    return downloaded(text) if is_address(text) else Path(text)


def checked_options(name: str, model: type[OptionsModel], given: Mapping[str, str]) -> OptionsModel:
    """The options of the plugin `name` as typed.

    Raises:
        PcdbenchError: for an option it does not have or a value it does not take.
    """
    try:
        return model.model_validate({key: _typed(model, key, text) for key, text in given.items()})
    except ValidationError as error:
        first = error.errors()[0]
        key = str(first["loc"][0]) if first["loc"] else ""
        if first["type"] == "extra_forbidden":
            keys = list(model.model_fields)
            cure = did_you_mean(key, keys) if keys else "it has no options"
            raise PcdbenchError(f"{name} has no option {key!r}; {cure} (see pcdbench show {name})") from None
        if first["type"] == "missing" and key not in given:
            raise PcdbenchError(
                f"{name} needs --option {name}.{key}=VALUE: it has no default (see pcdbench show {name})"
            ) from None
        if not first["loc"]:
            # What a model says of its options together.
            raise PcdbenchError(f"{name}: {problem_text(first['msg'])} (see pcdbench show {name})") from None
        value = given.get(key)
        problem, place = first["msg"], first["loc"][-1]
        if first["type"] == "missing" and isinstance(place, int):
            problem = f"value {place + 1} is missing"
        raise PcdbenchError(
            f"--option {name}.{key}={value}: {problem_text(problem)} (see pcdbench show {name})"
        ) from None


def _typed(model: type[BaseModel], key: str, text: str) -> Any:
    """The text of an option as pydantic takes it: a list or tuple is typed `1,2,3`, and None is typed `None`."""
    annotation = model.model_fields[key].annotation if key in model.model_fields else None
    alternatives = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    alternatives = tuple(get_args(one)[0] if get_origin(one) is Annotated else one for one in alternatives)
    if NoneType in alternatives and text == "None":
        return None
    # Of whole numbers that are named one by one pydantic takes no text.
    for named in (its for one in alternatives if get_origin(one) is Literal for its in get_args(one)):
        if str(named) == text:
            return named
    if any((get_origin(one) or one) in _SEQUENCES for one in alternatives):
        return [part.strip() for part in text.strip("()[] ").split(",") if part.strip()]
    return text


def _with_weights(plugin: Plugin, cls: Any) -> Plugin:
    """The completer with its weights' digest and model card, which only an instance with these options knows."""
    import pcdbench

    base = pcdbench.Completer
    if cls.weights_digest is base.weights_digest and cls.model_card is base.model_card:
        return plugin
    try:
        built = plugin.build()
        card, weights = checked_card(plugin.name, built.model_card()), built.weights_digest()
    except PcdbenchError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(f"completer {plugin.name!r} cannot say which weights it uses: {told(error)}") from error
    if not (weights is None or isinstance(weights, str)):
        kind = type(weights).__name__
        raise PluginError(f"completer {plugin.name!r}: weights_digest() must return a text or None, not {kind}")
    return replace(plugin, weights=weights, card=card)


def code_digest(cls: type) -> str:
    """Digest of the file that a class is in, or of its name where it has none."""
    try:
        return file_digest(Path(inspect.getfile(cls)))
    except (OSError, TypeError):
        return hashlib.sha256(cls.__qualname__.encode()).hexdigest()

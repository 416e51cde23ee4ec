"""Where plugins come from: the four hooks, and a registry that loads them one at a time and lazily.

Every completer, task, data set and incompleteness, ours included, is found through the entry-point group
`pcdbench`. An entry point names a module or object with any of the four hooks; registering is a name, a
one-line summary and where the class is, so that listing plugins imports none of what they need.
"""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import pluggy

from pcdbench.errors import PluginError, told

if TYPE_CHECKING:
    from pcdbench.task import Metric

GROUP = "pcdbench"
hookspec = pluggy.HookspecMarker(GROUP)
hookimpl = pluggy.HookimplMarker(GROUP)

Kind = Literal["completer", "task", "dataset", "incompleteness"]
KINDS: tuple[Kind, ...] = ("completer", "task", "dataset", "incompleteness")


class Register(Protocol):
    """What a hook is given: call it once for each thing that the plugin brings."""

    def __call__(
        self,
        name: str,
        target: str,
        summary: str,
        *,
        reference: bool = False,
        weights: Sequence[Path | str] = (),
        path: bool = True,
    ) -> None:
        """Register one thing.

        Args:
            name: what users type; lower case letters, digits and `_`.
            target: where the class is, as "package.module:Class"; imported when it is needed.
            summary: one line for `pcdbench list`.
            reference: a row to measure against, not a method (completers only).
            weights: the files of weights that its package brings and that it cannot do without (completers only).
            path: whether it lies somewhere, as `NAME:PATH` says; False for what is generated (data sets only).
        """


class HookSpecs:
    """The extension points, all of them."""

    @hookspec
    def register_completers(self, register: Register) -> None:
        """Register completers: subclasses of `pcdbench.Completer`."""

    @hookspec
    def register_tasks(self, register: Register) -> None:
        """Register tasks: subclasses of `pcdbench.Task`."""

    @hookspec
    def register_datasets(self, register: Register) -> None:
        """Register data sets: subclasses of `pcdbench.Dataset`."""

    @hookspec
    def register_incompletenesses(self, register: Register) -> None:
        """Register incompletenesses: subclasses of `pcdbench.Incompleteness`."""


_HOOK_OF_KIND: dict[Kind, str] = {
    "completer": "register_completers",
    "task": "register_tasks",
    "dataset": "register_datasets",
    "incompleteness": "register_incompletenesses",
}


BASE_OF_KIND: dict[Kind, str] = {
    "completer": "Completer",
    "task": "Task",
    "dataset": "Dataset",
    "incompleteness": "Incompleteness",
}


def load_target(target: str) -> Any:
    """Import what "package.module:Class" names; its import may raise anything."""
    module_name, _, attribute = target.partition(":")
    return getattr(importlib.import_module(module_name), attribute)


@dataclass(frozen=True)
class Registration:
    """One registered thing, not yet imported."""

    kind: Kind
    name: str
    target: str
    summary: str
    reference: bool
    origin: str
    weights: tuple[Path, ...] = ()
    path: bool = True

    @property
    def lacks_weights(self) -> bool:
        """Whether a file of weights that its package brings is not there."""
        return not all(path.is_file() for path in self.weights)

    def load(self) -> type[Any]:
        """Import the class.

        Raises:
            PluginError: naming the plugin, where it came from and what its import raised, or what the class is not.
        """
        try:
            cls = load_target(self.target)
        except (Exception, SystemExit) as error:
            raise PluginError(
                f"{self.kind} {self.name!r} from {self.origin} cannot be loaded from {self.target}: {told(error)}"
            ) from error
        _require_sound_class(self, cls)
        loaded: type[Any] = cls
        return loaded


def _require_sound_class(registration: Registration, cls: Any) -> None:
    """Refuse a class that is not what it is registered as, or whose declarations nobody could record."""
    import pcdbench

    who, base = f"{registration.kind} {registration.name!r}: {registration.target}", BASE_OF_KIND[registration.kind]
    if not (isinstance(cls, type) and issubclass(cls, getattr(pcdbench, base))):
        raise PluginError(f"{who} is not a subclass of pcdbench.{base}")
    if issubclass(cls, pcdbench.ReferenceCompleter) and not registration.reference:
        raise PluginError(f"{who} sees the complete cloud; register it with reference=True (it is not ranked)")
    declared: Any = cls
    if not isinstance(declared.version, str) or not declared.version:
        raise PluginError(f'{who} has the version {declared.version!r}; it must be a text such as "1"')
    if not (isinstance(declared.Options, type) and issubclass(declared.Options, pcdbench.Options)):
        raise PluginError(f"{who}: its Options must be a subclass of pcdbench.Options")
    if registration.kind == "task":
        if not declared.metrics:
            raise PluginError(f"{who} declares no metrics; set `metrics`, the main one first")
        listed = isinstance(declared.metrics, Sequence)
        if not (listed and all(isinstance(metric, pcdbench.Metric) for metric in declared.metrics)):
            raise PluginError(f"{who}: its metrics must be a tuple of pcdbench.Metric, not {declared.metrics!r}")
        _require_readable_rows(who, declared.metrics)


def _require_readable_rows(who: str, metrics: Sequence[Metric]) -> None:
    """Refuse metrics whose rows could not be read again: better now than after hours of running."""
    for metric in metrics:
        for what in ("name", "unit"):
            if not isinstance(getattr(metric, what), str):
                raise PluginError(f"{who}: the {what} of metric {metric.name!r} is no text: {getattr(metric, what)!r}")
        for what, known in (("direction", ("lower", "higher")), ("summary", ("median", "mean"))):
            if getattr(metric, what) not in known:
                its = getattr(metric, what)
                raise PluginError(f"{who}: the {what} of {metric.name} is {its!r}; {' or '.join(known)}")
    names = [metric.name for metric in metrics]
    if len(set(names)) < len(names):
        raise PluginError(f"{who} names a metric twice: {', '.join(names)}")


@dataclass
class Registry:
    """What all plugins registered, and which of them could not be loaded.

    Attributes:
        broken: by entry point: the error that loading it raised. Everything else goes on working.
    """

    broken: dict[str, str] = field(default_factory=dict)
    _found: dict[tuple[Kind, str], list[Registration]] = field(default_factory=dict)

    def add(self, registration: Registration) -> None:
        """Add a registration; a second one of the same kind and name is kept and reported as a clash."""
        self._found.setdefault((registration.kind, registration.name), []).append(registration)

    def all(self, kind: Kind) -> list[Registration]:
        """What is registered of a kind, by name; clashing names are left out (see `clashes`)."""
        return [both[0] for (its, _), both in sorted(self._found.items()) if its == kind and len(both) == 1]

    def clashes(self) -> list[str]:
        """One line for each name that two plugins claim."""
        return [_clash(both) for _, both in sorted(self._found.items()) if len(both) > 1]

    def clashing(self, kind: Kind) -> dict[str, str]:
        """By name, for each name of a kind that two plugins claim, the line that says so."""
        found = sorted(self._found.items())
        return {name: _clash(both) for (its, name), both in found if its == kind and len(both) > 1}

    def get(self, kind: Kind, name: str) -> Registration:
        """The registration of this name.

        Raises:
            PluginError: where there is none (with the names it may have meant), or more than one.
        """
        found = self._found.get((kind, name), [])
        if len(found) == 1:
            return found[0]
        if found:
            raise PluginError(_clash(found))
        names = [registration.name for registration in self.all(kind)]
        raise PluginError(f"no {kind} is called {name!r}; {did_you_mean(name, names)}" + self._broken_note())

    def find(self, name: str) -> list[Registration]:
        """What is registered under this name, of whatever kind: at least one registration.

        Raises:
            PluginError: where there is none (with the names it may have meant), or where two plugins claim it.
        """
        kinds = [kind for kind in KINDS if (kind, name) in self._found]
        if kinds:
            return [self.get(kind, name) for kind in kinds]
        names = sorted({registration.name for kind in KINDS for registration in self.all(kind)})
        raise PluginError(f"nothing is called {name!r}; {did_you_mean(name, names)}" + self._broken_note())

    def _broken_note(self) -> str:
        if not self.broken:
            return ""
        return f" (not loaded: {', '.join(sorted(self.broken))}; see pcdbench list)"


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Half a sentence that names the closest of `names`, or all of them."""
    known = list(names)
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    if close:
        return f"did you mean {' or '.join(close)}?"
    return f"there is {', '.join(known) or 'nothing of that kind'}"


def _clash(registrations: list[Registration]) -> str:
    first = registrations[0]
    origins = " and ".join(registration.origin for registration in registrations)
    return f"{first.kind} {first.name!r} is registered by {origins}; uninstall one of them"


@cache
def registry() -> Registry:
    """The registry of everything installed, loaded once a process."""
    return load_registry(entry_points(group=GROUP))


def load_registry(found: Iterable[EntryPoint]) -> Registry:
    """Load these entry points one at a time: a broken one costs nothing but itself."""
    result = Registry()
    for entry_point in sorted(found, key=lambda point: (point.name, point.value)):
        origin = _origin(entry_point)
        try:
            for registration in _registrations(entry_point.load(), origin):
                result.add(registration)
        except (Exception, SystemExit) as error:
            # A plugin may raise anything at import, or leave where a library of its own is missing.
            result.broken[origin] = told(error)
    return result


def _registrations(plugin: object, origin: str) -> list[Registration]:
    """What one plugin registers, or its first error: all of it or nothing."""
    manager = pluggy.PluginManager(GROUP)
    manager.add_hookspecs(HookSpecs)
    manager.register(plugin)
    manager.check_pending()
    if not manager.get_hookcallers(plugin):
        hooks = ", ".join(_HOOK_OF_KIND.values())
        raise PluginError(f"it has none of the hooks {hooks}; mark them with @pcdbench.hookimpl")
    found: list[Registration] = []
    for kind, hook in _HOOK_OF_KIND.items():

        def register(
            name: str,
            target: str,
            summary: str,
            *,
            reference: bool = False,
            weights: Sequence[Path | str] = (),
            path: bool = True,
            kind: Kind = kind,
        ) -> None:
            if not name.replace("_", "a").isalnum() or not name.isascii() or name != name.lower():
                raise PluginError(f"{kind} name {name!r} may hold only lower case letters, digits and _")
            if ":" not in target:
                raise PluginError(f'{kind} {name!r}: target {target!r} must look like "package.module:Class"')
            if not isinstance(summary, str):
                raise PluginError(f"{kind} {name!r}: summary {summary!r} must be a text of one line")
            files = _paths(f"{kind} {name!r}", weights)
            found.append(Registration(kind, name, target, summary, reference, origin, files, path))

        getattr(manager.hook, hook)(register=register)
    return found


def _paths(who: str, weights: Sequence[Path | str]) -> tuple[Path, ...]:
    """The files of weights that a plugin registered; one alone counts as a list of it."""
    try:
        return tuple(map(Path, [weights] if isinstance(weights, str | Path) else weights))
    except TypeError:
        raise PluginError(f"{who}: weights {weights!r} must be a list of paths") from None


def _origin(entry_point: EntryPoint) -> str:
    distribution = f"{entry_point.dist.name} {entry_point.dist.version}" if entry_point.dist else "?"
    return f"{distribution} ({entry_point.name} = {entry_point.value})"

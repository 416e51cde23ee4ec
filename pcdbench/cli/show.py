"""`pcdbench show NAME`: what one plugin is, what it measures or offers, and its options."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin

import typer

from pcdbench.errors import PcdbenchError
from pcdbench.plugins import Registration, registry

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from pcdbench.options import Options


def show(name: Annotated[str, typer.Argument(help="A name from `pcdbench list`.")]) -> None:
    """Show one plugin: where it is from, whom to cite, its metrics or splits, its options."""
    described = ["\n".join(_description(registration)) for registration in registry().find(name)]
    typer.echo("\n\n".join(described))


def _description(registration: Registration) -> Iterator[str]:
    plugin = registration.load()
    yield f"{registration.name}: {registration.kind}{', a reference' if registration.reference else ''}"
    yield f"  {registration.summary}"
    yield ""
    yield f"  from       {registration.origin}"
    yield f"  class      {registration.target}"
    yield f"  version    {plugin.version}"
    if registration.kind in ("completer", "task"):
        yield f"  needs      {'points and their colours' if plugin.needs_color else 'points alone'}"
    if registration.kind == "completer" and plugin.citation:
        yield f"  cite       {plugin.citation}"
    if registration.kind == "dataset":
        yield f"  splits     {_splits(plugin)}"
    if plugin.__doc__:
        yield ""
        yield from ("  " + line if line else "" for line in inspect.getdoc(plugin).splitlines())  # type: ignore[union-attr]
    if registration.kind == "task":
        yield from _metrics(plugin)
    yield from _options(registration.name, plugin.Options)


def _splits(plugin: Any) -> str:
    """The splits, the default one first named; where the data set needs a path to tell, what it says."""
    try:
        names = plugin().splits()
    except PcdbenchError as error:
        return f"default {plugin.default_split}; {error}"
    return ", ".join(f"{name} (default)" if name == plugin.default_split else name for name in names)


def _metrics(plugin: Any) -> Iterator[str]:
    yield ""
    yield "  metrics, the main one first"
    for metric in plugin.metrics:
        yield f"    {metric.name}  [{metric.unit}], {metric.direction} is better, summed up by its {metric.summary}"
        yield f"        {metric.formula}"


def _options(name: str, model: type[Options]) -> Iterator[str]:
    yield ""
    if not model.model_fields:
        yield "  options: none"
        return
    yield "  options"
    for key, field in model.model_fields.items():
        default = "required" if field.is_required() else f"default {_default(field) or 'empty'}"
        yield f"    {key}  {_type(field)}, {default}"
        if field.description:
            yield f"        {field.description}"
    key, field = next(iter(model.model_fields.items()))
    yield ""
    yield f"  for example: --option {name}.{key}={_default(field) or 'VALUE'}"


def _default(field: FieldInfo) -> str:
    """The text of the default; empty where that is empty, and where there is none."""
    return "" if field.is_required() else _value(field.get_default(call_default_factory=True))


def _type(field: FieldInfo) -> str:
    """The type as an author would write it, with its bounds: `float > 0`."""
    return _bounded(_annotation(field.annotation), field.metadata)


def _annotation(annotation: Any) -> str:
    """The text of a type; of a tuple with the bounds of what it holds: `tuple[float > 0, ...]`."""
    if get_origin(annotation) is Annotated:
        inner, *metadata = get_args(annotation)
        return _bounded(_annotation(inner), [bound for its in metadata for bound in getattr(its, "metadata", [its])])
    if get_origin(annotation) is tuple:
        return f"tuple[{', '.join('...' if its is ... else _annotation(its) for its in get_args(annotation))}]"
    return inspect.formatannotation(annotation)


def _bounded(text: str, metadata: Iterable[Any]) -> str:
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    bounds = [
        f"{sign} {getattr(bound, attribute)}"
        for bound in metadata
        for attribute, sign in signs.items()
        if getattr(bound, attribute, None) is not None
    ]
    return " ".join([text, " and ".join(bounds)]) if bounds else text


def _value(value: Any) -> str:
    """A value as it is typed on the command line."""
    if isinstance(value, (list, tuple)):
        return ",".join(map(_value, value))
    return str(value)

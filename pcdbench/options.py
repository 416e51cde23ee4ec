"""Options of a plugin: a pydantic model it declares, so that they can be shown, checked and recorded."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Options(BaseModel):
    """Base of every plugin's options: frozen; unknown names are errors, and so are numbers that are not finite.

    A plugin declares a subclass as its `Options`; each field has a default, a type and a description::

        class PlaneFitting(pcdbench.Completer):
            class Options(pcdbench.Options):
                distance_m: float = Field(0.02, gt=0, description="inlier distance of a plane, metres")

            options: Options
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def changed(options: Options, *names: str) -> list[str]:
    """Those of these options that have another value than their default.

    Options that are read back from a row have all their values, so that whether one was given tells nothing.
    """
    fields = type(options).model_fields
    return [name for name in names if getattr(options, name) != fields[name].default]

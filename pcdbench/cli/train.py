"""`pcdbench train NAME`: train a learned completer on an endless stream of generated, augmented rooms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pcdbench.errors import PcdbenchError

if TYPE_CHECKING:
    from pcdbench.completer import Completer
    from pcdbench.options import Options


def train(
    name: Annotated[str, typer.Argument(help="A completer that learns, or a part of it (deeppcd.color).")],
    out: Annotated[Path, typer.Option(help="The folder for checkpoint, weights, model card and curve.")],
    hours: Annotated[float | None, typer.Option(min=0.0, help="Train this long, all resumptions together.")] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Train this many steps.")] = None,
    start: Annotated[Path | None, typer.Option("--from", help="Begin from these weights of the same network.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the checkpoint in --out.")] = False,
    preset: Annotated[str, typer.Option(help="The optimizer's settings, by name.")] = "default",
    device: Annotated[str, typer.Option(help="auto, cpu or cuda.")] = "auto",
    option: Annotated[
        list[str] | None, typer.Option(help="NAME.KEY=VALUE: an option of the completer, for training and validation.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Decides the data and the first weights.")] = 0,
    workers: Annotated[int, typer.Option(min=0, max=1024, help="Processes that prepare examples.")] = 1,
) -> None:
    """Train a completer that learns. Stop it at any moment; --resume goes on."""
    from pcdbench.plugins import did_you_mean, registry
    from pcdbench.training.trainee import load_trainee

    # A completer of several networks names the trainee of its part PART as `PART_trainee`.
    completer_name, _, part = name.partition(".")
    completer = registry().get("completer", completer_name).load()
    target = getattr(completer, f"{part}_trainee" if part else "trainee", None)
    if target is None:
        raise PcdbenchError(f"{name} learns nothing, so there is nothing to train")
    if hours is not None and not math.isfinite(hours):
        raise PcdbenchError(f"--hours {hours} must be a number of hours")
    if device not in ("auto", "cpu", "cuda"):
        raise PcdbenchError(f"--device {device!r} must be auto, cpu or cuda")
    there = (out / "checkpoint.safetensors").exists()
    if there and not resume:
        raise PcdbenchError(f"{out} holds a training already; go on with --resume or give another --out")
    options = _options(name, completer, option or ())
    trainee = load_trainee(name, target, options)
    if preset not in trainee.presets:
        raise PcdbenchError(f"{name} has no preset {preset!r}; {did_you_mean(preset, trainee.presets)}")
    chosen = trainee.presets[preset]
    if hours is None and steps is None and chosen.steps is None:
        raise PcdbenchError("say how long to train: --hours H or --steps S")
    # Whatever stops a training, before its first checkpoint too, the same command goes on.
    if resume and not there:
        typer.echo(f"{out} holds no checkpoint to resume: the training begins from nothing", err=True)
    from accelerate import PartialState

    from pcdbench.training.card import write_card
    from pcdbench.training.loop import Budget
    from pcdbench.training.loop import train as train_loop
    from pcdbench.training.stream import PairStream
    from pcdbench.training.validation import Validation
    from pcdbench.weights import Weights, weights_option

    stream = PairStream(seed)
    progress = train_loop(
        trainee,
        out,
        Budget(chosen.steps if hours is None and steps is None else steps, hours),
        preset=chosen,
        stream=stream,
        start=None if start is None else Weights(start, str(start), name),
        resume=resume,
        name=name,
        options=options,
        device=device,
        workers=workers,
        validate=Validation(),
        report=lambda line: typer.echo(line, err=True),
    )
    if not PartialState().is_main_process:
        return
    weights = out / "weights.safetensors"
    write_card(weights, name, stream, chosen, progress)
    typer.echo(f"weights: {weights} (use them with --option {weights_option(name)}={weights})")


def _options(name: str, completer: type[Completer], texts: Sequence[str]) -> Options:
    """The options of the completer to train, or of which a part is."""
    from pcdbench.runner.selection import checked_options, parse_options
    from pcdbench.weights import weights_option

    completer_name, _, own = weights_option(name).partition(".")
    given = parse_options(texts)
    if set(given) - {completer_name}:
        other = min(set(given) - {completer_name})
        raise PcdbenchError(f"--option {other}.…: only {completer_name} is trained; leave it out")
    its = given.get(completer_name, {})
    if own in its:
        raise PcdbenchError(
            f"--option {completer_name}.{own}={its[own]}: these weights are what is trained; --from FILE begins from "
            "others"
        )
    return checked_options(completer_name, completer.Options, its)

"""The training loop: fresh pairs from loader workers, one optimizer, checkpoints, validation, a curve."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from accelerate import Accelerator
from accelerate.utils import broadcast
from filelock import FileLock
from pydantic import TypeAdapter, ValidationError
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

from pcdbench.completer import Completer
from pcdbench.errors import PcdbenchError, first_problem, told, warn_in_one_line
from pcdbench.files import UNFINISHED
from pcdbench.keys import seed_from
from pcdbench.options import Options
from pcdbench.runner.cards import seen_along
from pcdbench.runner.store import claimed
from pcdbench.threads import children_limited, thread_count
from pcdbench.training.checkpoint import load_checkpoint, save_checkpoint, save_weights
from pcdbench.training.curve import Curve
from pcdbench.training.precision import bfloat16_pays
from pcdbench.training.stream import PairStream
from pcdbench.training.trainee import Example, Preset, Trainee
from pcdbench.weights import CARD_SUFFIX, Weights
from pcdbench.workers import end_as_a_group

AVERAGE_DECAY = 0.998
CLIP = 1.0
WARM_UP = 100  # steps
DRAW_EVERY_S = 300.0
OVERFLOWS = 5  # steps in a row with gradients that are not finite, after which something is wrong
PATIENCE = 2  # checks without a better validation error, after which `plateau` lowers the rate


@dataclass(frozen=True)
class Budget:
    """How long to train: by steps or by hours, whichever is spent first.

    Raises:
        PcdbenchError: where either is not greater than zero.
    """

    steps: int | None = None
    hours: float | None = None

    def __post_init__(self) -> None:
        for what, value in (("steps", self.steps), ("hours", self.hours)):
            if value is not None and not value > 0:
                raise PcdbenchError(f"{what} must be greater than zero, not {value:g}")

    def spent(self, step: int, seconds: float) -> float:
        """The share of the budget that is used up, 0 to 1: what the learning rate follows."""
        shares = [0.0]
        if self.steps is not None:
            shares.append(step / self.steps)
        if self.hours is not None:
            shares.append(seconds / (3600 * self.hours))
        return min(1.0, max(shares))


@dataclass
class Progress:
    """Where a training is; checkpoints hold it.

    Attributes:
        step: steps done.
        seconds: time spent training, over all resumptions.
        validation: the latest validation error; best: the lowest; waited: checks since then.
        rate: what `plateau` has left of the learning rate.
        terms: running means of the loss's terms.
        overflowed: steps in a row that were left out, their gradients not being finite.
        begun_from: which weights it began from (`Weights.origin`), if any.
        seed: of the stream, which a resumption must have, too.
        name: of what is trained (`deeppcd.color`), likewise.
        preset: likewise.
        options: those of the completer that are not at their default, likewise.
    """

    step: int = 0
    seconds: float = 0.0
    validation: float | None = None
    best: float | None = None
    waited: int = 0
    rate: float = 1.0
    terms: dict[str, float] = field(default_factory=dict)
    overflowed: int = 0
    begun_from: dict[str, Any] | None = None
    seed: int | None = None
    name: str | None = None
    preset: Preset | None = None
    options: dict[str, Any] | None = None

    def validated(self, error: float) -> None:
        """Take a new validation error and, after too many without a better one, lower the rate."""
        self.validation = error
        if self.best is None or error < self.best:
            self.best, self.waited = error, 0
            return
        self.waited += 1
        if self.waited >= PATIENCE:
            self.rate, self.waited = self.rate / 10, 0

    def losses(self, losses: dict[str, float]) -> None:
        """Take the terms of one more example into the running means."""
        for name, value in losses.items():
            self.terms[name] = 0.99 * self.terms.get(name, value) + 0.01 * value

    def line(self, budget: Budget) -> str:
        """The progress as people read it."""
        share = budget.spent(self.step, self.seconds)
        left = self.seconds / share - self.seconds if share else 0.0
        terms = ", ".join(f"{name} {value:.4f}" for name, value in self.terms.items())
        validation = (
            "no validation yet" if self.validation is None else f"validation ChD {self.validation:.3f} of doing nothing"
        )
        return (
            f"step {self.step}: {terms}, {validation}, "
            f"{self.seconds / max(self.step, 1):.2f} s a step, {left / 60:.0f} min left"
        )


class _Examples(Dataset):
    """Examples by index, made where the loader's workers run."""

    def __init__(self, trainee: Trainee, stream: PairStream) -> None:
        self._trainee, self._stream = trainee, stream

    def __getitem__(self, index: int) -> Example:
        rng = np.random.default_rng(seed_from("example", self._stream.seed, index))
        return self._trainee.example(self._stream[index], rng)


def resumed(
    path: Path,
    network: nn.Module,
    average: dict[str, Tensor],
    optimizer: torch.optim.Optimizer,
    name: str | None = None,
) -> Progress:
    """Where the training of a checkpoint was; network, average and optimizer are restored in place.

    Args:
        name: of what is trained.

    Raises:
        PcdbenchError: where the file is not a checkpoint of this network.
    """
    try:
        return TypeAdapter(Progress).validate_python(load_checkpoint(path, network, average, optimizer, name))
    except ValidationError as error:
        raise PcdbenchError(
            f"{path} does not say where its training was ({first_problem(error)}); give another --out"
        ) from None


def train(
    trainee: Trainee,
    out: Path,
    budget: Budget,
    *,
    preset: Preset | None = None,
    stream: PairStream | None = None,
    start: Weights | None = None,
    resume: bool = False,
    name: str | None = None,
    options: Options | None = None,
    device: str = "auto",
    workers: int = 1,
    validate: Callable[[Any], float] | None = None,
    validate_every_s: float = 900.0,
    save_every_s: float = 60.0,
    report: Callable[[str], None] = print,
) -> Progress:
    """Train until the budget is spent. Kill it at any moment, and go on with `resume`.

    Args:
        out: receives `checkpoint.safetensors`, `weights.safetensors` (the averaged network, float16), `curve.csv`
            and `curve.png`.
        preset: the trainee's `default` unless given.
        stream: where the pairs come from; its seed decides the first weights too, unless `start` gives them.
        start: weights of the same network to begin from.
        resume: go on from the checkpoint in `out`, if there is one: the next examples are those that would have come.
        name: of the completer, or of its part; a checkpoint that holds another one is refused by its name.
        options: those of the completer; a checkpoint of others is refused, and the model card tells them.
        device: `auto`, `cpu` or `cuda`. Several GPUs and machines are used where `accelerate launch` starts this.
        workers: loader processes that prepare examples.
        validate: the validation error of a completer; the progress line and the curve show it.
        report: takes the progress line, now and then.

    Raises:
        PcdbenchError: where the checkpoint, or `start`, is of another network, where the checkpoint is of another seed,
            preset, options or `start`, where boards could not read the card of `start`, where `validate` would have no
            completer to ask, where there is no GPU for `cuda`, where `out` cannot be made or written or another
            training is at it, or where the loss is not finite any more or a loader process dies.
    """
    preset = trainee.presets["default"] if preset is None else preset
    stream = PairStream() if stream is None else stream
    _require_place(out, device)
    if validate is not None:
        # Not hours later, when there is something to validate; before the seed is set, so that nothing else changes.
        _require_completer(trainee)
    torch.manual_seed(stream.seed)
    torch.set_num_threads(thread_count())
    accelerator = Accelerator(mixed_precision="bf16" if bfloat16_pays(device) else "no", cpu=device == "cpu")
    state = _State.begun(trainee, out, preset, start)
    goes_on = resume and state.checkpoint.exists()
    if goes_on:
        state.resume(name)
    progress = state.progress
    given = {} if options is None else options.model_dump(mode="json", exclude_defaults=True)
    if goes_on:
        _require_same(state.checkpoint, progress, stream.seed, preset, given, trainee.presets)
        if start is not None and (progress.begun_from or {}).get("sha256") != start.digest:
            raise PcdbenchError(f"{state.checkpoint} did not begin from {start.path}; go on without --from")
    # Of several processes one alone writes: what another has not finished would be taken for torn.
    lock = state.claimed(goes_on) if accelerator.is_main_process else None
    progress.seed, progress.name = stream.seed, name or progress.name
    progress.preset, progress.options = preset, given
    network, state.optimizer = accelerator.prepare(state.network, state.optimizer)
    batches = _batches(trainee, stream, preset, progress.step, workers, accelerator)
    began, saved, validated, drawn, reported = time.monotonic() - progress.seconds, *(4 * [time.monotonic()])
    whole = True  # not in the middle of a step, nor of its check
    try:
        while (spent := _of_main(accelerator, budget, progress)) < 1.0:
            share = progress.rate if preset.schedule == "plateau" else _cosine(spent, progress.step)
            for group in state.optimizer.param_groups:
                group["lr"] = preset.learning_rate * share * group.get("rate", 1.0)
            examples, whole = next(batches), False
            _step(trainee, network, state.optimizer, accelerator, examples, progress)
            _lerp(state.average, state.network, progress.step)
            progress.step, progress.seconds = progress.step + 1, time.monotonic() - began
            if not accelerator.is_main_process:
                continue
            done = budget.spent(progress.step, progress.seconds) >= 1.0
            now = time.monotonic()
            due = (
                now - validated > validate_every_s
                if preset.validate_every is None
                else progress.step % preset.validate_every == 0
            )
            if validate and (done or due):
                progress.validated(validate(trainee.completer(_averaged(trainee, state.average))))
                validated = time.monotonic()
            whole = True
            if done or now - saved >= save_every_s:
                draw = done or now - drawn >= DRAW_EVERY_S
                state.save(draw)
                saved = time.monotonic()
                drawn = saved if draw else drawn
            if done or now - reported > 10.0:
                report(progress.line(budget))
                reported = now
        if accelerator.is_main_process and not state.weights.exists():  # moved away since the training had ended
            state.save(draw=True)
    except KeyboardInterrupt:
        # Half a step is not saved: it would be taken again. Nor is a step without its check, which would not be made
        # again. The last minute's checkpoint is there; where no step was taken since, the files stay as they are.
        if accelerator.is_main_process and whole and progress.step != state.held:
            state.save()
        raise
    except RuntimeError as error:
        # Torch raises no kind of its own, and at any moment: a signal told it.
        if not str(error).startswith("DataLoader worker"):
            raise
        raise PcdbenchError(
            f"a process that prepares examples has died ({error}), most likely for want of memory; give fewer "
            "--workers, and go on from the last checkpoint with --resume"
        ) from error
    finally:
        if lock is not None:
            lock.release()
    return progress


@dataclass(eq=False)
class _State:
    """All that a training changes, and the files that hold it.

    Attributes:
        network: as the trainee made it, whatever accelerate wraps around it.
        average: the running mean of its weights, which becomes the weights' file.
        held: the step that the files hold.
    """

    trainee: Trainee
    out: Path
    network: nn.Module
    average: dict[str, Tensor]
    optimizer: torch.optim.Optimizer
    progress: Progress
    held: int = 0

    def __post_init__(self) -> None:
        self.checkpoint, self.curve = self.out / "checkpoint.safetensors", Curve(self.out)
        self.weights = self.out / "weights.safetensors"

    @classmethod
    def begun(cls, trainee: Trainee, out: Path, preset: Preset, start: Weights | None) -> _State:
        """A training before its first step."""
        network, progress = trainee.network(), Progress()
        if start is not None:
            start.begin(network, trainee.completes)
            progress.begun_from = start.origin()
            seen_along(progress.begun_from, str(start.path))  # not hours later, when the card is written
        average = {name: value.detach().clone() for name, value in network.state_dict().items()}
        return cls(trainee, out, network, average, _optimizer(trainee, network, preset), progress)

    def resume(self, name: str | None) -> None:
        """Go on from the checkpoint, which is that of a training of this name."""
        self.progress = resumed(self.checkpoint, self.network, self.average, self.optimizer, name)
        self.held = self.progress.step

    def claimed(self, goes_on: bool) -> FileLock:
        """The folder's lock; what a training that was stopped left there, and this one makes again, is gone."""
        lock = claimed(self.out)
        for torn in self.out.glob(UNFINISHED):
            torn.unlink()
        self.curve.cut(self.progress.step if goes_on else -1)
        return lock

    def save(self, draw: bool = False) -> None:
        """Keep all of it, the curve's picture if asked for."""
        progress = self.progress
        weights = {name: value for name, value in self.average.items() if self.trainee.completes(name)}
        # The card of a training that ended and goes on would describe other weights, and have these refused.
        self.weights.with_suffix(CARD_SUFFIX).unlink(missing_ok=True)
        save_weights(self.weights, weights)
        self.curve.add(progress.step, progress.seconds, progress.terms, progress.validation)
        if draw:
            self.curve.draw()
        # The checkpoint last: killed at any moment before, what was saved with it is made again.
        save_checkpoint(self.checkpoint, self.network, self.average, self.optimizer, asdict(progress))
        self.held = progress.step


def _require_place(out: Path, device: str) -> None:
    """Have the folder made, and refuse one that cannot be written, or a GPU that is not there."""
    if device == "cuda" and not torch.cuda.is_available():
        raise PcdbenchError("this machine has no GPU that torch finds; give --device auto or cpu")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PcdbenchError(f"{out} cannot be made ({error.strerror}); give another folder") from None
    if not os.access(out, os.W_OK):
        raise PcdbenchError(f"{out} cannot be written; give another folder")


def _require_same(
    checkpoint: Path,
    progress: Progress,
    seed: int,
    preset: Preset,
    options: Mapping[str, Any],
    presets: Mapping[str, Preset],
) -> None:
    """Refuse to go on with a training otherwise than it began, where the checkpoint tells how."""
    if progress.seed not in (None, seed):
        raise PcdbenchError(f"{checkpoint} is of seed {progress.seed}; go on with --seed {progress.seed}")
    if progress.preset not in (None, preset):
        name = next((name for name, one in presets.items() if one == progress.preset), None)
        if name is None:
            raise PcdbenchError(f"{checkpoint} is of a preset that is not there any more; give another --out")
        raise PcdbenchError(f"{checkpoint} is of preset {name}; go on with --preset {name}")
    if progress.options not in (None, options):
        raise PcdbenchError(f"{checkpoint} is of options {json.dumps(progress.options)}; go on with the same --option")


def _require_completer(trainee: Trainee) -> None:
    """Have the trainee make a completer of a network that learned nothing: what raises would raise at the end, too."""
    made: Any = None
    try:
        made = trainee.completer(trainee.network().eval())
    except Exception as error:
        # A trainee may be another's, and raises what it likes.
        problem = told(error) if not isinstance(error, PcdbenchError) else str(error)
    else:
        problem = "" if isinstance(made, Completer) else f"it returned {type(made).__name__}, not a completer"
    if problem:
        raise PcdbenchError(
            f"{type(trainee).__name__}.completer(network) makes no completer of a network that is there already "
            f"({problem}); see docs/training.md"
        )


def _of_main(accelerator: Accelerator, budget: Budget, progress: Progress) -> float:
    """The share of the budget that is spent; of several processes all follow the clock and the rate of the main one."""
    spent = budget.spent(progress.step, progress.seconds)
    if accelerator.num_processes == 1:
        return spent
    told = torch.tensor([spent, progress.rate], dtype=torch.float64, device=accelerator.device)
    spent, progress.rate = broadcast(told).tolist()
    return spent


def _step(
    trainee: Trainee,
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    accelerator: Accelerator,
    examples: list[Example],
    progress: Progress,
) -> None:
    optimizer.zero_grad()
    for example in examples:
        moved = {name: torch.as_tensor(value).to(accelerator.device) for name, value in example.items()}
        with accelerator.autocast():
            losses = trainee.loss(network, moved)
        accelerator.backward(losses["loss"] / len(examples))
        progress.losses({name: float(value.detach()) for name, value in losses.items()})
    # Each group by itself: of a network of two sides, as of a GAN, one side's gradients do not shrink the other's.
    norms = [accelerator.clip_grad_norm_(group["params"], CLIP) for group in optimizer.param_groups]
    if all(bool(torch.isfinite(torch.as_tensor(norm))) for norm in norms):
        optimizer.step()
        progress.overflowed = 0
        return
    progress.overflowed += 1
    # One batch whose gradients overflow in bfloat16 teaches nothing, and does no harm if it is left out.
    if progress.overflowed >= OVERFLOWS or not all(np.isfinite(value) for value in progress.terms.values()):
        raise PcdbenchError(
            f"the loss is not finite any more at step {progress.step}; go on from the last checkpoint with --resume"
        )


def _optimizer(trainee: Trainee, network: nn.Module, preset: Preset) -> torch.optim.Optimizer:
    groups = list(trainee.parameter_groups(network))
    return torch.optim.AdamW(groups, lr=preset.learning_rate, weight_decay=preset.weight_decay)


def _batches(
    trainee: Trainee, stream: PairStream, preset: Preset, step: int, workers: int, accelerator: Accelerator
) -> Iterator[list[Example]]:
    """What each step from this one on learns from; each process of several takes its own."""
    size, count = preset.batch, accelerator.num_processes
    indices = (
        [(at * count + accelerator.process_index) * size + item for item in range(size)] for at in range(step, 1 << 32)
    )
    loader: DataLoader = DataLoader(
        _Examples(trainee, stream),
        batch_sampler=indices,
        num_workers=workers,
        collate_fn=trainee.collate,
        worker_init_fn=_begin_worker,
        prefetch_factor=4 if workers else None,
        multiprocessing_context="spawn" if workers else None,
    )
    with children_limited(1):
        return iter(loader)


def _begin_worker(_: int) -> None:
    warn_in_one_line()
    end_as_a_group()
    torch.set_num_threads(1)


def _cosine(spent: float, step: int) -> float:
    """The share of the full learning rate: a warm-up, then a cosine down to 1 %."""
    return min(1.0, (step + 1) / WARM_UP) * (0.01 + 0.99 * 0.5 * (1 + float(np.cos(np.pi * spent))))


def _lerp(average: dict[str, Tensor], network: nn.Module, step: int) -> None:
    """Move the averaged weights towards the network's, faster at first."""
    decay = min(AVERAGE_DECAY, (1 + step) / (10 + step))
    for name, value in network.state_dict().items():
        if value.is_floating_point():
            average[name].lerp_(value.detach().to(average[name]), 1 - decay)
        else:
            average[name].copy_(value)


def _averaged(trainee: Trainee, average: dict[str, Tensor]) -> nn.Module:
    network = trainee.network()
    network.load_state_dict(average)
    return network.eval()

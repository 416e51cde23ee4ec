"""The training loop: it learns, it resumes bit by bit after a kill, its files say what happened."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import torch
from accelerate import Accelerator
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import nn
from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.cloud import PointCloud
from pcdbench.completer import Completer
from pcdbench.errors import PcdbenchError
from pcdbench.files import keep
from pcdbench.options import Options
from pcdbench.runner.cards import checked_card
from pcdbench.runner.store import claimed
from pcdbench.training import loop
from pcdbench.training import truths as truths_module
from pcdbench.training.card import write_card
from pcdbench.training.checkpoint import load_checkpoint, save_checkpoint, save_weights
from pcdbench.training.curve import Curve
from pcdbench.training.loop import Budget, Progress, _step, train
from pcdbench.training.stream import PairStream, TrainingPair
from pcdbench.training.trainee import Example, Preset, Trainee
from pcdbench.training.truths import Truth
from pcdbench.weights import Weights, model_card


class HeightTrainee(Trainee):
    """Learns the mean height of what is missing from the extent of what is there."""

    presets: ClassVar = {
        "default": Preset(learning_rate=0.02, batch=2),
        "published": Preset(learning_rate=0.01, batch=1, schedule="plateau", weight_decay=0.0, validate_every=1),
    }

    def network(self) -> nn.Module:
        return nn.Sequential(nn.Linear(3, 16), nn.BatchNorm1d(16, track_running_stats=True).eval(), nn.Linear(16, 1))

    def example(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
        kept = pair.complete.points[pair.kept]
        return {
            "extent": np.ptp(kept, axis=0).astype(np.float32) + rng.normal(scale=1e-3, size=3).astype(np.float32),
            "height": pair.complete.points[~pair.kept, 2].mean(keepdims=True).astype(np.float32),
        }

    def loss(self, network: nn.Module, example: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        error = (network(example["extent"][None])[0] - example["height"]).square().mean()
        return {"loss": error, "height": error.sqrt()}

    def completer(self, network: nn.Module) -> Completer:
        raise NotImplementedError


class Standing(Completer):
    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        return cloud


def small_room(index: int) -> Truth:
    rng = np.random.default_rng(index)
    points = rng.uniform(0, 1, (400, 3)) * (2.0, 2.0, 1.0 + index % 3)
    return Truth(PointCloud(points), np.zeros(400, np.uint8))


@pytest.fixture(autouse=True)
def small_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(truths_module, "training_truth", small_room)


def trained(out: Path, steps: int, **options: Any) -> Progress:
    return train(HeightTrainee(), out, Budget(steps=steps), workers=0, report=lambda _: None, device="cpu", **options)


def card_of(out: Path, progress: Progress) -> dict[str, Any]:
    return write_card(out / "weights.safetensors", "height", PairStream(), HeightTrainee.presets["default"], progress)


def test_it_learns(tmp_path: Path) -> None:
    progress = trained(tmp_path, 60, save_every_s=0.0)
    curve = Curve(tmp_path).table()
    assert list(curve["step"]) == list(range(1, 61))
    assert progress.terms["loss"] < 0.8 * curve["loss"].iloc[0]
    assert (tmp_path / "curve.png").stat().st_size > 5_000


def test_stopped_anywhere_and_resumed_the_weights_are_the_same_bit_by_bit(tmp_path: Path) -> None:
    class Stop(Exception):
        pass

    def stop_at(step: int) -> Any:
        def validate(_: object) -> float:
            validate.calls += 1  # type: ignore[attr-defined]
            if validate.calls == step:  # type: ignore[attr-defined]
                raise Stop
            return 1.0

        validate.calls = 0  # type: ignore[attr-defined]
        return validate

    class Seen(HeightTrainee):
        presets: ClassVar = {"default": Preset(learning_rate=0.02, batch=2, validate_every=1)}

        def completer(self, network: nn.Module) -> Completer:
            return Standing()

    options = {"workers": 0, "report": lambda _: None, "device": "cpu", "save_every_s": 0.0}
    train(Seen(), tmp_path / "whole", Budget(steps=12), validate=lambda _: 1.0, **options)
    for stop in (3, 4, 1):
        with pytest.raises(Stop):
            train(Seen(), tmp_path / "parts", Budget(steps=12), validate=stop_at(stop), resume=True, **options)
    torn = tmp_path / "parts" / ".unfinished-abcd.safetensors"  # what a kill in the middle of saving leaves
    torn.touch()
    train(Seen(), tmp_path / "parts", Budget(steps=12), validate=lambda _: 1.0, resume=True, **options)
    assert not torn.exists()
    for name in ("weights.safetensors",):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "parts" / name).read_bytes()
    whole, parts = (Curve(tmp_path / run).table() for run in ("whole", "parts"))
    assert whole["loss"].tolist() == parts["loss"].tolist()


@pytest.mark.parametrize("what", ["save_weights", "save_checkpoint", "Curve.add", "Curve.draw"])
def test_killed_in_its_last_save_it_is_saved_whole_by_the_resumption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    trained(tmp_path / "whole", 2)

    def killed(*_: object) -> None:
        raise SystemExit

    with monkeypatch.context() as patch, pytest.raises(SystemExit):
        patch.setattr(f"pcdbench.training.loop.{what}", killed)
        trained(tmp_path / "parts", 2)
    trained(tmp_path / "parts", 2, resume=True)
    whole, parts = ((tmp_path / run / "weights.safetensors").read_bytes() for run in ("whole", "parts"))
    assert whole == parts
    assert list(Curve(tmp_path / "parts").table()["step"]) == [2]
    assert (tmp_path / "parts" / "curve.png").exists()


def test_ctrl_c_in_a_save_leaves_one_line_of_it_in_the_curve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saving = loop.save_checkpoint

    def interrupted(*args: Any) -> None:
        monkeypatch.setattr(loop, "save_checkpoint", saving)
        raise KeyboardInterrupt

    monkeypatch.setattr(loop, "save_checkpoint", interrupted)
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path, 2, save_every_s=0.0)
    assert list(Curve(tmp_path).table()["step"]) == [1] and self_steps(tmp_path) == 1


def test_what_is_saved_can_be_read_by_whom_other_files_can(tmp_path: Path) -> None:
    trained(tmp_path, 1)
    assert len({path.stat().st_mode for path in tmp_path.iterdir()}) == 1


@pytest.mark.parametrize("name", ["weights.safetensors", "checkpoint.safetensors"])
def test_a_disk_that_is_full_is_told_with_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    network = nn.Linear(100, 100)
    state = {key: value.clone() for key, value in network.state_dict().items()}
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, limits[1]))
    try:
        with pytest.raises(OSError) as full:
            if name == "weights.safetensors":
                save_weights(tmp_path / name, state)
            else:
                save_checkpoint(tmp_path / name, network, state, torch.optim.AdamW(network.parameters()), {})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert full.value.errno == errno.EFBIG and full.value.filename == str(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_of_several_processes_the_main_one_alone_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Accelerator, "is_main_process", False)
    trained(tmp_path, 1)
    assert list(tmp_path.iterdir()) == []


def test_a_kill_at_any_moment_leaves_a_checkpoint_to_go_on_from(tmp_path: Path) -> None:
    script = tmp_path / "child.py"
    script.write_text(
        "import sys; sys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\n"
        "import test_training_loop as t\n"
        "t.truths_module.training_truth = t.small_room\n"
        "t.trained(Path(sys.argv[1]), 10**6, save_every_s=0.0, resume=True)\n"
    )
    rng = np.random.default_rng(0)
    out, steps = tmp_path / "out", [0]
    for _ in range(2):
        child = subprocess.Popen([sys.executable, str(script), str(out), str(Path(__file__).parent)])
        deadline = time.monotonic() + 60
        while self_steps(out) <= steps[-1] and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(rng.uniform(0, 0.3))
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
        steps.append(self_steps(out))
    assert steps == sorted(set(steps))


def self_steps(out: Path) -> int:
    """The steps that the checkpoint holds; loading it whole shows that it is whole."""
    path = out / "checkpoint.safetensors"
    if not path.exists():
        return 0
    network = HeightTrainee().network()
    optimizer = torch.optim.AdamW(network.parameters())
    return load_checkpoint(path, network, {}, optimizer)["step"]


def test_a_checkpoint_of_another_network_is_refused(tmp_path: Path) -> None:
    trained(tmp_path, 2)
    network = nn.Linear(2, 2)
    with pytest.raises(PcdbenchError, match="not a checkpoint of this network"):
        load_checkpoint(tmp_path / "checkpoint.safetensors", network, {}, torch.optim.AdamW(network.parameters()))
    (tmp_path / "checkpoint.safetensors").write_bytes(b"\x80\x04pickle")
    with pytest.raises(PcdbenchError, match="not a checkpoint"):
        trained(tmp_path, 4, resume=True)


def test_what_only_training_needs_is_left_out_of_the_weights(tmp_path: Path) -> None:
    class Half(HeightTrainee):
        def completes(self, tensor: str) -> bool:
            return tensor.startswith("0.")

    train(Half(), tmp_path, Budget(steps=1), workers=0, report=lambda _: None, device="cpu")
    weights = Weights(tmp_path / "weights.safetensors", str(tmp_path / "weights.safetensors"), "half")
    assert set(weights.tensors()) == {"0.weight", "0.bias"}
    # What they leave out begins anew.
    train(Half(), tmp_path / "more", Budget(steps=1), workers=0, report=lambda _: None, device="cpu", start=weights)
    with pytest.raises(PcdbenchError, match="another network than half"):
        trained(tmp_path / "all", 1, start=weights)


def test_layers_may_share_their_weights(tmp_path: Path) -> None:
    class Shared(HeightTrainee):
        def network(self) -> nn.Module:
            layer = nn.Linear(3, 3)
            return nn.Sequential(layer, nn.Tanh(), layer, nn.Linear(3, 1))

    for steps in (1, 2):
        train(Shared(), tmp_path, Budget(steps), resume=True, workers=0, report=lambda _: None, device="cpu")
    weights = load_file(tmp_path / "weights.safetensors")
    assert torch.equal(weights["0.weight"], weights["2.weight"])


def test_weights_are_halved_but_where_float16_cannot_hold_them(tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    tensors = {"large": torch.tensor([1.0, 1e5]), "small": torch.tensor([1.5]), "count": torch.tensor(7)}
    save_weights(path, tensors)
    assert {name: value.dtype for name, value in load_file(path).items()} == {
        "large": torch.float32,
        "small": torch.float16,
        "count": torch.int64,
    }
    weights = Weights(path, str(path), "these")
    assert all(torch.equal(value, tensors[name]) for name, value in weights.tensors().items())
    save_weights(path, {"broken": torch.tensor([1.0, float("inf")])})
    with pytest.raises(PcdbenchError, match=r"infinite or undefined numbers \(broken\)"):
        Weights(path, str(path), "these").tensors()


def test_it_begins_from_weights_and_tells_which(tmp_path: Path) -> None:
    preset = HeightTrainee.presets["default"]
    first, second = tmp_path / "first", tmp_path / "second"
    card = write_card(first / "weights.safetensors", "height", PairStream(), preset, trained(first, 40))
    start = Weights(first / "weights.safetensors", str(first / "weights.safetensors"), "height")
    trained(second, 1, start=start, save_every_s=0.0)
    with pytest.raises(PcdbenchError, match=r"did not begin from .*second/weights\.safetensors; go on without"):
        other = second / "weights.safetensors"
        trained(second, 2, start=Weights(other, str(other), "height"), resume=True)
    progress = trained(second, 2, start=start, resume=True, save_every_s=0.0)
    progress = trained(second, 2, resume=True, save_every_s=0.0)
    curves = [Curve(folder).table() for folder in (first, second)]
    assert curves[1]["loss"].iloc[0] < 0.8 * curves[0]["loss"].iloc[0]
    told = write_card(second / "weights.safetensors", "height", PairStream(), preset, progress)["begun_from"]
    assert told["sha256"] == card["sha256"] and told["steps"] == 40 and told["begun_from"] is None


def test_what_the_weights_it_began_from_were_trained_on_it_was_trained_on(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    card = card_of(first, trained(first, 1))
    leak = {"dataset": "indoor", "split": "test"}
    # The older kind of card: what its weights began from is told under `begun_from` alone.
    card |= {"begun_from": {"trained_on": [leak, card["trained_on"][0]]}}
    told = first / "weights.card.json"
    told.write_text(json.dumps(card))
    weights = first / "weights.safetensors"
    tuned = card_of(second, trained(second, 1, start=Weights(weights, str(weights), "height")))
    assert tuned["trained_on"] == [card["trained_on"][0], leak]
    told.write_text(json.dumps(card | {"trained_on": "indoor"}))
    with pytest.raises(PcdbenchError, match=r"trained on \(trained_on: input should be a valid list"):
        trained(tmp_path / "third", 1, start=Weights(weights, str(weights), "height"))


def test_ctrl_c_in_the_middle_of_a_step_leaves_the_last_whole_one(tmp_path: Path) -> None:
    class Normalised(HeightTrainee):
        interrupt = 0

        def network(self) -> nn.Module:
            return nn.Sequential(nn.Linear(3, 16), nn.BatchNorm1d(16), nn.Linear(16, 1))

        def loss(self, network: nn.Module, example: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
            loss = (network(example["extent"] + torch.eye(3)) - example["height"]).square().mean()
            self.interrupt -= 1
            if self.interrupt == 0:
                raise KeyboardInterrupt
            return {"loss": loss}

    options = {"workers": 0, "report": lambda _: None, "device": "cpu", "save_every_s": 0.0}
    train(Normalised(), tmp_path / "whole", Budget(steps=5), **options)
    stopped = Normalised()
    stopped.interrupt = 6  # the second of the third step's two examples
    with pytest.raises(KeyboardInterrupt):
        train(stopped, tmp_path / "parts", Budget(steps=5), **options)
    train(Normalised(), tmp_path / "parts", Budget(steps=5), resume=True, **options)
    whole, parts = ((tmp_path / run / "weights.safetensors").read_bytes() for run in ("whole", "parts"))
    assert whole == parts


def test_ctrl_c_before_the_first_step_leaves_a_training_that_ends_with_a_card_in_json(tmp_path: Path) -> None:
    class Stopped(HeightTrainee):
        def example(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(Stopped(), tmp_path, Budget(steps=2), workers=0, report=lambda _: None, device="cpu")
    progress = trained(tmp_path, 2, resume=True)
    with pytest.raises(KeyboardInterrupt):
        train(Stopped(), tmp_path, Budget(steps=4), workers=0, report=lambda _: None, device="cpu", resume=True)
    assert list(Curve(tmp_path).table()["step"]) == [2]
    card = card_of(tmp_path, progress)
    assert checked_card("height", card) == card


def test_what_is_not_finite_in_a_curve_is_null_in_the_card(tmp_path: Path) -> None:
    progress = trained(tmp_path, 1)
    (tmp_path / "curve.csv").write_text("step,seconds,validation_chd,loss\n0,0.0,,\n1,0.0,inf,0.5\n")
    card = card_of(tmp_path, progress)
    assert [(point["loss"], point["validation"]) for point in card["curve"]] == [(None, None), (0.5, None)]


def test_a_training_that_goes_on_has_weights_that_load_until_it_ends(tmp_path: Path) -> None:
    class Stopped(HeightTrainee):
        steps = 0

        def collate(self, examples: Any) -> list[Example]:
            self.steps += 1
            if self.steps > 2:
                raise KeyboardInterrupt
            return list(examples)

    weights = tmp_path / "weights.safetensors"
    card_of(tmp_path, trained(tmp_path, 1))
    assert Weights(weights, str(weights), "height").card is not None
    with pytest.raises(KeyboardInterrupt):
        train(Stopped(), tmp_path, Budget(steps=9), workers=0, report=lambda _: None, device="cpu", resume=True)
    assert self_steps(tmp_path) == 3 and Weights(weights, str(weights), "height").card is None


def test_ctrl_c_in_a_check_leaves_the_check_to_the_resumption(tmp_path: Path) -> None:
    class Seen(HeightTrainee):
        def completer(self, network: nn.Module) -> Completer:
            return Standing()

    checks = iter([1.0, 1.0, KeyboardInterrupt])

    def interrupted(_: object) -> float:
        check = next(checks)
        if check is KeyboardInterrupt:
            raise KeyboardInterrupt
        return check

    options = {"workers": 0, "report": lambda _: None, "device": "cpu", "preset": HeightTrainee.presets["published"]}
    train(Seen(), tmp_path / "whole", Budget(steps=6), validate=lambda _: 1.0, **options)
    with pytest.raises(KeyboardInterrupt):
        train(Seen(), tmp_path / "parts", Budget(steps=6), validate=interrupted, save_every_s=0.0, **options)
    train(Seen(), tmp_path / "parts", Budget(steps=6), validate=lambda _: 1.0, resume=True, **options)
    whole, parts = ((tmp_path / run / "weights.safetensors").read_bytes() for run in ("whole", "parts"))
    assert whole == parts


def test_another_seed_does_not_go_on_with_a_training(tmp_path: Path) -> None:
    trained(tmp_path, 2, stream=PairStream(3))
    with pytest.raises(PcdbenchError, match="is of seed 3; go on with --seed 3"):
        trained(tmp_path, 4, stream=PairStream(4), resume=True)
    assert trained(tmp_path, 4, stream=PairStream(3), resume=True).step == 4


def test_another_preset_or_other_options_do_not_go_on_with_a_training(tmp_path: Path) -> None:
    class Size(Options):
        grid: int = 5
        color: str = "nearest"

    published, checkpoint = HeightTrainee.presets["published"], tmp_path / "checkpoint.safetensors"
    trained(tmp_path, 2, options=Size(grid=7))
    with pytest.raises(PcdbenchError, match="is of preset default; go on with --preset default"):
        trained(tmp_path, 4, options=Size(grid=7), preset=published, resume=True)
    with pytest.raises(PcdbenchError, match=r'is of options \{"grid": 7\}; go on with the same --option'):
        trained(tmp_path, 4, resume=True)
    progress = trained(tmp_path, 4, options=Size(grid=7, color="nearest"), resume=True)
    assert progress.step == 4 and card_of(tmp_path, progress)["options"] == {"grid": 7}
    # The older kind of checkpoint tells of neither.
    with safe_open(checkpoint, "pt") as stored:
        tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118 - not a mapping
        told = json.loads(stored.metadata()["progress"])
    del told["preset"], told["options"]
    save_file(tensors, checkpoint, {"progress": json.dumps(told)})
    assert trained(tmp_path, 5, preset=published, resume=True).step == 5


def test_a_checkpoint_tells_of_what_it_is(tmp_path: Path) -> None:
    trained(tmp_path, 2, name="height")
    with pytest.raises(PcdbenchError, match="holds a training of height, not of width; train height, or give another"):
        trained(tmp_path, 4, name="width", resume=True)
    assert trained(tmp_path, 4, name="height", resume=True).step == 4

    class Wider(HeightTrainee):
        def network(self) -> nn.Module:
            return nn.Linear(3, 1)

    with pytest.raises(PcdbenchError, match=r"this network \(its network is one of other tensors\)"):
        train(Wider(), tmp_path, Budget(steps=6), workers=0, report=lambda _: None, device="cpu", resume=True)


@pytest.mark.parametrize(
    ("made", "problem"),
    [
        (TypeError("unexpected keyword 'network'"), "TypeError: unexpected keyword 'network'"),
        (PcdbenchError("the weights are not there"), "the weights are not there"),
        (None, "it returned NoneType, not a completer"),
    ],
)
def test_a_trainee_that_makes_no_completer_is_told_before_the_first_step(
    tmp_path: Path, made: Exception | None, problem: str
) -> None:
    class Unfinished(HeightTrainee):
        def completer(self, network: nn.Module) -> Any:
            if made is not None:
                raise made

    options = {"workers": 0, "report": lambda _: None, "device": "cpu", "validate": lambda _: 1.0}
    with pytest.raises(PcdbenchError) as caught:
        train(Unfinished(), tmp_path, Budget(steps=1), **options)
    assert f"Unfinished.completer(network) makes no completer of a network that is there already ({problem})" in str(
        caught.value
    )
    assert not list(tmp_path.iterdir())


class ForNobody:
    @classmethod
    def for_options(cls, options: object) -> ForNobody:
        return cls()


@pytest.mark.parametrize(
    ("target", "problem"),
    [
        (f"{__name__}:Typo", "has no attribute 'Typo'; it must be \"package.module:Class\""),
        ("no_such_module:Typo", "ModuleNotFoundError: No module named 'no_such_module'; it must be"),
        ("pcdbench.training.trainee:Trainee", "TypeError: Can't instantiate abstract class Trainee"),
        (f"{__name__}:ForNobody", "gave ForNobody, not a pcdbench.training.trainee.Trainee"),
    ],
)
def test_a_trainee_that_is_none_is_one_line(tmp_path: Path, monkeypatch, target: str, problem: str) -> None:
    monkeypatch.setattr("pcdbench_completers.voxel_unet.completer.VoxelUNetCompleter.trainee", target)
    ended = CliRunner().invoke(app, ["train", "voxel_unet", "--steps", "1", "--out", str(tmp_path / "new")])
    assert ended.exit_code == 2 and ended.stderr.count("\n") == 1
    assert ended.stderr.startswith("pcdbench: voxel_unet cannot be trained: ")
    assert repr(target) in ended.stderr and problem in ended.stderr


def test_a_gpu_that_is_not_there_is_told_and_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(PcdbenchError, match="no GPU that torch finds; give --device auto or cpu"):
        train(HeightTrainee(), tmp_path / "out", Budget(steps=1), workers=0, device="cuda")
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)  # tests of whom everything is allowed find no such folder
    with pytest.raises(PcdbenchError, match="cannot be written; give another folder"):
        trained(tmp_path, 1)


def test_a_folder_belongs_to_one_training_at_a_time(tmp_path: Path) -> None:
    trained(tmp_path, 1)
    (tmp_path / ".unfinished-abcd.safetensors").touch()  # what the other one is writing
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    lock = claimed(tmp_path)
    with pytest.raises(PcdbenchError, match=r"is in use by another pcdbench; wait for it to end"):
        trained(tmp_path, 2, resume=True)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    lock.release()
    assert trained(tmp_path, 2, resume=True).step == 2


def test_weights_that_were_moved_away_are_written_again(tmp_path: Path) -> None:
    trained(tmp_path, 2)
    written = (tmp_path / "weights.safetensors").read_bytes()
    (tmp_path / "weights.safetensors").unlink()
    assert trained(tmp_path, 2, resume=True).step == 2
    assert (tmp_path / "weights.safetensors").read_bytes() == written


@pytest.mark.parametrize(
    ("name", "option"), [("voxel_unet", "voxel_unet.weights"), ("deeppcd.color", "deeppcd.color_weights")]
)
def test_weights_as_an_option_are_not_what_a_training_begins_from(tmp_path: Path, name: str, option: str) -> None:
    ended = CliRunner().invoke(app, ["train", name, "--steps", "1", "--option", f"{option}=w", "--out", str(tmp_path)])
    told = f"pcdbench: --option {option}=w: these weights are what is trained; --from FILE begins from others\n"
    assert (ended.exit_code, ended.stderr) == (2, told)


def test_no_time_to_train_is_one_line(tmp_path: Path) -> None:
    ended = CliRunner().invoke(app, ["train", "voxel_unet", "--hours", "0", "--out", str(tmp_path / "new")])
    assert (ended.exit_code, ended.stderr) == (2, "pcdbench: hours must be greater than zero, not 0\n")
    with pytest.raises(PcdbenchError, match="steps must be greater than zero, not -1"):
        Budget(steps=-1)


def test_resuming_where_nothing_is_begins_from_nothing_and_says_so(tmp_path: Path, monkeypatch) -> None:
    asked = []

    def stopped(*_: Any, **given: Any) -> None:
        asked.append((given["resume"], given["options"].threshold))
        raise PcdbenchError("stopped")

    monkeypatch.setattr("pcdbench.training.loop.train", stopped)
    options = ["--steps", "1", "--resume", "--option", "voxel_unet.threshold=0.5"]
    ended = CliRunner().invoke(app, ["train", "voxel_unet", *options, "--out", str(tmp_path / "new")])
    told = f"{tmp_path / 'new'} holds no checkpoint to resume: the training begins from nothing\n"
    assert asked == [(True, 0.5)] and ended.stderr == f"{told}pcdbench: stopped\n"


def test_a_loss_that_is_not_finite_ends_it_before_the_checkpoint_is_lost(tmp_path: Path) -> None:
    class Diverging(HeightTrainee):
        def loss(self, network: nn.Module, example: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
            loss = super().loss(network, example)["loss"]
            return {"loss": loss * (float("nan") if (tmp_path / "checkpoint.safetensors").exists() else 1.0)}

    with pytest.raises(PcdbenchError, match="not finite any more at step 1; go on from the last checkpoint"):
        train(Diverging(), tmp_path, Budget(steps=5), workers=0, report=lambda _: None, device="cpu", save_every_s=0.0)
    assert self_steps(tmp_path) == 1


class Short(HeightTrainee):
    """Its examples are made where nothing can be kept and memory runs out."""

    def example(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
        keep(Path(os.devnull) / "folder" / "crop.npz", Path.touch)
        os.kill(os.getpid(), signal.SIGKILL)
        return {}


class NoPairs(PairStream):
    def __getitem__(self, index: int) -> Any:
        return None


def test_what_happens_to_a_loader_worker_is_told_in_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(PcdbenchError, match=r"a process that prepares examples has died .*; give fewer --workers"):
        train(Short(), tmp_path, Budget(steps=1), stream=NoPairs(), workers=1, device="cpu")
    assert capfd.readouterr().err.startswith("pcdbench: what is made is not kept: /dev/null/folder cannot be written")


def test_a_step_whose_gradients_overflow_is_left_out_but_not_one_after_the_other(tmp_path: Path) -> None:
    class Overflowing(HeightTrainee):
        calls, every = 0, 3

        def loss(self, network: nn.Module, example: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
            loss = super().loss(network, example)["loss"]
            self.calls += 1
            # The root of zero is finite, its gradient is not.
            return {"loss": loss + (loss * 0).sqrt() if self.calls % self.every == 0 else loss}

    trainee = Overflowing()
    budget, options = Budget(steps=20), {"workers": 0, "report": lambda _: None, "device": "cpu"}
    assert train(trainee, tmp_path, budget, **options).step == 20
    assert all(torch.isfinite(value).all() for value in load_file(tmp_path / "weights.safetensors").values())
    trainee.every = 1
    with pytest.raises(PcdbenchError, match="not finite any more at step 4"):
        train(trainee, tmp_path, budget, **options)


def test_the_gradients_of_each_group_are_clipped_to_a_norm_of_one() -> None:
    class Steep(HeightTrainee):
        def loss(self, network: nn.Module, example: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
            steep, gentle = network.parameters()
            return {"loss": 30 * steep[0, 0] + 40 * steep[0, 1] + 0.5 * gentle[0, 0]}

    network = nn.ModuleList([nn.Linear(2, 1, bias=False), nn.Linear(1, 1, bias=False)])
    before = [value.detach().clone() for value in network.parameters()]
    optimizer = torch.optim.SGD([{"params": part.parameters()} for part in network], lr=1.0)
    _step(Steep(), network, optimizer, Accelerator(cpu=True), [{}, {}], Progress())
    moved = [was - value.detach() for was, value in zip(before, network.parameters(), strict=True)]
    torch.testing.assert_close(moved[0], torch.tensor([[0.6, 0.8]]))
    torch.testing.assert_close(moved[1], torch.tensor([[0.5]]))


def test_the_plateau_rule_lowers_the_rate_after_two_checks_without_a_better_one() -> None:
    progress = Progress()
    for error in (1.0, 0.5, 0.6, 0.55, 0.5, 0.4):
        progress.validated(error)
    assert progress.rate == pytest.approx(0.1)
    assert (progress.best, progress.waited) == (0.4, 0)


def test_a_line_of_progress_tells_the_validation_once_there_is_one() -> None:
    progress = Progress(step=2, seconds=120.0, terms={"loss": 0.5})
    budget = Budget(steps=4)
    assert progress.line(budget) == "step 2: loss 0.5000, no validation yet, 60.00 s a step, 2 min left"
    progress.validated(0.8)
    assert ", validation ChD 0.800 of doing nothing, " in progress.line(budget)


def test_the_card_describes_the_weights_and_a_changed_file_is_refused(tmp_path: Path) -> None:
    preset = HeightTrainee.presets["default"]
    progress = trained(tmp_path, 3, save_every_s=0.0)
    path = tmp_path / "weights.safetensors"
    card = write_card(path, "height", PairStream(), preset, progress)
    assert card == model_card(path)
    assert (card["steps"], card["pairs"], card["license"]) == (3, 6, "Apache-2.0")
    assert [point["step"] for point in card["curve"]] == [1, 2, 3]
    weights = Weights(path, "", "height")
    network = weights.load_into(HeightTrainee().network())
    assert all(value.dtype == torch.float32 for value in network.state_dict().values() if value.is_floating_point())
    with pytest.raises(PcdbenchError, match="another network than height"):
        weights.load_into(nn.Linear(2, 2))
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(PcdbenchError, match="not the file that its model card describes"):
        Weights(path, "", "height")
    with pytest.raises(PcdbenchError, match="pcdbench train height"):
        Weights(tmp_path / "none.safetensors", "", "height")
    own = tmp_path / "own.safetensors"
    own.write_bytes(b"\x80\x04]q\x00.")
    with pytest.raises(PcdbenchError, match="does not hold weights"):
        Weights(path, str(own), "height").tensors()

"""Checkpoints without pickle that survive a kill at any moment: safetensors, replaced as a whole."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from pcdbench.errors import PcdbenchError
from pcdbench.files import whole_file


def save_checkpoint(
    path: Path, network: nn.Module, average: Mapping[str, Tensor], optimizer: torch.optim.Optimizer, progress: dict
) -> None:
    """Write everything needed to go on, into one file that is either the old one or the new one."""
    from safetensors.torch import save

    tensors = {f"network/{name}": value for name, value in network.state_dict().items()}
    tensors |= {f"average/{name}": value for name, value in average.items()}
    for index, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{index}/{name}": value for name, value in state.items()}
    # Copies, as safetensors takes no two tensors of one memory, which layers that share their weights have.
    tensors = {
        name: value.detach().cpu().clone(memory_format=torch.contiguous_format) for name, value in tensors.items()
    }
    with whole_file(path, sync=True) as unfinished:
        unfinished.write_bytes(save(tensors, metadata={"progress": json.dumps(progress)}))


def load_checkpoint(
    path: Path,
    network: nn.Module,
    average: dict[str, Tensor],
    optimizer: torch.optim.Optimizer,
    name: str | None = None,
) -> dict[str, Any]:
    """Restore network, average and optimizer in place; returns the progress that was saved.

    Args:
        name: of what is trained.

    Raises:
        PcdbenchError: where the file is not a checkpoint of this network.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, "pt") as stored:
            progress = json.loads((stored.metadata() or {}).get("progress", ""))
            _require_name(path, progress, name)
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118 - not a mapping
        _require_shapes(_under("network/", tensors), network.state_dict(), "network")
        network.load_state_dict(_under("network/", tensors))
        _require_shapes(_under("average/", tensors), network.state_dict(), "average")
        state: dict[int, dict[str, Tensor]] = {}
        for name, value in _under("optimizer/", tensors).items():
            index, _, key = name.partition("/")
            state.setdefault(int(index), {})[key] = value
        _require_state(state, optimizer)
        optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
    except (OSError, SafetensorError, KeyError, ValueError, RuntimeError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise PcdbenchError(f"{path} is not a checkpoint of this network ({reason}); give another --out") from error
    average.update(_under("average/", tensors))
    return progress


def save_weights(path: Path, average: Mapping[str, Tensor]) -> None:
    """Write the averaged network as completers ship it: in float16, and what that cannot hold in float32."""
    from safetensors.torch import save

    halved = {name: _halved(value.detach().cpu().contiguous()) for name, value in average.items()}
    with whole_file(path) as unfinished:
        # Its own writing of files hides them from other users, and a full disk is no OSError.
        unfinished.write_bytes(save(halved))


def _halved(value: Tensor) -> Tensor:
    """In float16, unless it is a number of another kind or so large that it would become infinite."""
    if not value.is_floating_point():
        return value
    half = value.half()
    return half if bool(torch.isfinite(half).all()) else value


def _require_name(path: Path, progress: Any, name: str | None) -> None:
    """Refuse the training of something else, where the checkpoint tells of what it is."""
    held = progress.get("name") if isinstance(progress, dict) else None
    if name is not None and held is not None and held != name:
        raise PcdbenchError(f"{path} holds a training of {held}, not of {name}; train {held}, or give another --out")


def _require_shapes(tensors: Mapping[str, Tensor], like: Mapping[str, Tensor], what: str) -> None:
    """Raise ValueError unless these are tensors of the same names and shapes."""
    if {name: its.shape for name, its in tensors.items()} != {name: its.shape for name, its in like.items()}:
        raise ValueError(f"its {what} is one of other tensors")


def _require_state(state: Mapping[int, Mapping[str, Tensor]], optimizer: torch.optim.Optimizer) -> None:
    """Raise ValueError unless this is the optimizer's state: the same entries, each a number or of its tensor's shape.

    Torch looks at none of this before the next step.
    """
    parameters = [its for group in optimizer.param_groups for its in group["params"]]
    for index, its in state.items():
        shapes = (parameters[index].shape, ()) if 0 <= index < len(parameters) else ()
        if its.keys() != next(iter(state.values())).keys() or any(value.shape not in shapes for value in its.values()):
            raise ValueError(f"the state of its optimizer is damaged at tensor {index}")


def _under(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}

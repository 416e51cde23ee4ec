"""The completers that come with pcdbench, registered exactly as a third party's would be."""

from pathlib import Path

from pcdbench.plugins import Register, hookimpl

_HERE = Path(__file__).parent


@hookimpl
def register_completers(register: Register) -> None:
    here = "pcdbench_completers"
    register("incomplete", f"{here}.reference:Incomplete", "does nothing: the floor", reference=True)
    register("ground_truth", f"{here}.reference:GroundTruth", "the complete cloud itself: the truth", reference=True)
    register(
        "resample",
        f"{here}.reference:Resample",
        "another sample of the dense cloud: the ceiling",
        reference=True,
    )
    register("plane_fitting", f"{here}.plane_fitting:PlaneFitting", "planes by RANSAC, their gaps filled")
    register("hole_filling", f"{here}.hole_filling:HoleFilling", "a mesh of near neighbours, its holes filled")
    register(
        "voxel_unet",
        f"{here}.voxel_unet.completer:VoxelUNetCompleter",
        "a 3D U-Net over voxels: surface where nobody looked",
        weights=[_HERE / "voxel_unet" / "weights.safetensors"],
    )
    deeppcd = [_HERE / "deeppcd" / "weights.safetensors"]
    register(
        "deeppcd",
        f"{here}.deeppcd.completer:DeepPCD",
        "DeepPCD: the network's own cloud, as published",
        weights=deeppcd,
    )
    register(
        "deeppcd_merged",
        f"{here}.deeppcd.completer:DeepPCDMerged",
        "the observed points, and DeepPCD's where nothing was observed",
        weights=deeppcd,
    )
    for name, target in (("pcn", "PCN"), ("foldingnet", "FoldingNet")):
        register(
            name,
            f"{here}.{name}.completer:{target}",
            f"{target}, patch by patch",
            weights=[_HERE / name / "weights.safetensors"],
        )

"""The completers that come with pcdbench, registered exactly as a third party's would be."""

from pcdbench.plugins import Register, hookimpl


@hookimpl
def register_completers(register: Register) -> None:
    here = "pcdbench_completers"
    register("incomplete", f"{here}.reference:Incomplete", "does nothing: the floor", reference=True)
    register("ground_truth", f"{here}.reference:GroundTruth", "the complete cloud: the oracle", reference=True)
    register(
        "resample",
        f"{here}.reference:Resample",
        "another sample of the dense cloud: the ceiling",
        reference=True,
    )
    register("plane_fitting", f"{here}.plane_fitting:PlaneFitting", "planes by RANSAC, their gaps filled")
    register("hole_filling", f"{here}.hole_filling:HoleFilling", "a mesh of near neighbours, its holes filled")

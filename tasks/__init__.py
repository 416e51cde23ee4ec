"""The tasks that come with pcdbench, registered exactly as a third party's would be."""

from pcdbench.plugins import Register, hookimpl


@hookimpl
def register_tasks(register: Register) -> None:
    here = "pcdbench_tasks"
    register("chamfer", f"{here}.chamfer:Chamfer", "Chamfer distance and its relatives: is the geometry right?")
    register("ssim", f"{here}.ssim:Ssim", "six-face structural similarity: does it look right?")
    register("localization", f"{here}.localization:Localization", "where am I, from one scan and no prior?")
    register("tracking", f"{here}.tracking:Tracking", "where am I, step by step along a walk?")
    register("tagging", f"{here}.tagging:Tagging", "are the tagged objects still there?")

"""The hooks of this plugin. Importing it is cheap: the classes are imported when they are needed."""

from pcdbench import Register, hookimpl


@hookimpl
def register_completers(register: Register) -> None:
    register("midpoints", "pcdbench_example.midpoints:Midpoints", "points between neighbours that lie far apart")


@hookimpl
def register_tasks(register: Register) -> None:
    register("coverage", "pcdbench_example.coverage:Coverage", "how much of the truth has a point nearby?")

"""A run without worker processes, for tests that plant things in this one."""

from pcdbench.runner.completions import CompletionCache
from pcdbench.runner.execute import Executor


class InThisProcess:
    """Runs cells here and now, without a cache."""

    workers = 1

    def run(self, jobs, dataset):
        executor = Executor(dataset, CompletionCache(limit_mb=0))
        for job in jobs:
            yield job, executor.rows(job.cell, job.tasks)

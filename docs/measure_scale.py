"""Measures what the harness costs beside its cells, and simulates a thousand workers from what it measured.

    python docs/measure_scale.py [PART ...]

where a part is `overhead` (cells of about 100 ms, one worker), `workers` (two workers against one), `many` (100,000
cells planned, resumed and summarised), `dask` (what a cell costs the client and the scheduler) or `simulate` (a
thousand workers, by what `dask` measures); all of them unless given.
"""

from __future__ import annotations

import heapq
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
from pydantic import Field

import pcdbench
from pcdbench import Case, Completer, Dataset, Incompleteness, Measurements, Metric, PointCloud, Scene, Task
from pcdbench.plugins import Register, hookimpl
from pcdbench.runner.plan import Plan, Request, plan

COMPLETERS = tuple(f"busy_{number}" for number in range(5))
METRICS = ("chd", "accuracy_m", "completeness_m", "f_score", "hole_chd")
CELL_SECONDS = 0.1
POINTS = 20_000
MANY = {"scenes": 2500, "draws": 2}
MANY_LEVELS = (0.1, 0.3, 0.5, 0.7)
FEW, MORE = 2, 12
RUN_WORKERS = (1, 2)
NETWORK_SECONDS = 0.0005


# The plugins: this module is one, so that worker processes find them.


@hookimpl
def register_datasets(register: Register) -> None:
    register("busy", "measure_scale:Busy", "random points, any number of scenes")


@hookimpl
def register_incompletenesses(register: Register) -> None:
    register("busy_cut", "measure_scale:Cut", "the last points are missing")


@hookimpl
def register_completers(register: Register) -> None:
    for name in COMPLETERS:
        register(name, "measure_scale:Compute", "computes for a while")


@hookimpl
def register_tasks(register: Register) -> None:
    register("busy_task", "measure_scale:Five", "five numbers")


class Busy(Dataset):
    class Options(pcdbench.Options):
        scenes: int = 4
        draws: int = 1

    options: Options
    default_split = "all"

    def splits(self) -> Sequence[str]:
        return ["all"]

    def scene_names(self, split: str) -> Sequence[str]:
        return [f"scene{number:05d}" for number in range(self.options.scenes)]

    def draws(self, split: str) -> int:
        return self.options.draws

    def digest(self, name: str) -> str:
        return name

    def scene(self, name: str) -> Scene:
        rng = np.random.default_rng(int(name[5:]))
        cloud = PointCloud(rng.random((POINTS, 3)), rng.random((POINTS, 3)))
        return Scene(name, cloud, cloud, np.arange(POINTS))


class Cut(Incompleteness):
    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> np.ndarray:
        return np.arange(len(scene.complete)) < len(scene.complete) - round(level * len(scene.complete))


class Compute(Completer):
    class Options(pcdbench.Options):
        rounds: int = Field(0, description="how long to compute: always the same work, whoever does it")

    options: Options

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        compute(self.options.rounds)
        return cloud


class Five(Task):
    metrics = tuple(Metric(name, "m", "lower", "a random number") for name in METRICS)

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        return Measurements({name: rng.random(1) for name in METRICS})


def compute(rounds: int) -> int:
    """Work that keeps one core busy and holds nothing in memory."""
    value = 1
    for _ in range(rounds):
        value = value * 1103515245 % 2147483647
    return value


def rounds_for(seconds: float) -> int:
    """How many rounds of `compute` take so many seconds of processor time here."""
    tried = 200_000
    start = time.process_time()
    compute(tried)
    return int(tried * seconds / (time.process_time() - start))


@contextmanager
def installed() -> Iterator[Path]:
    """These plugins, found by this process and all that it starts; gives a folder for runs."""
    from pcdbench.plugins import registry

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        described = folder / "plugins" / "measure_scale-1.0.dist-info"
        described.mkdir(parents=True)
        (described / "METADATA").write_text("Metadata-Version: 2.1\nName: measure-scale\nVersion: 1.0\n")
        (described / "entry_points.txt").write_text("[pcdbench]\nmeasure_scale = measure_scale\n")
        own = [str(described.parent), str(Path(__file__).parent)]
        sys.path[:0] = own
        os.environ["PYTHONPATH"] = os.pathsep.join([*own, os.environ.get("PYTHONPATH", "")])
        os.environ["PCDBENCH_CACHE"] = str(folder / "cache")
        registry.cache_clear()
        yield folder


def planned(
    draws: int, rounds: int, scenes: int = 4, levels: Sequence[float] = (0.1, 0.3, 0.5), completers: int = 1
) -> Plan:
    """A plan with scenes x draws x levels x completers cells."""
    names = COMPLETERS[:completers]
    options = [f"busy.draws={draws}", f"busy.scenes={scenes}", *(f"{name}.rounds={rounds}" for name in names)]
    return plan(Request(names, ["busy_task"], "busy", None, ["busy_cut"], levels, options=options, references=False))


# The parts.


def elapsed(draws: int, rounds: int, workers: int, folder: Path) -> tuple[int, float, float]:
    """Cells of a run, its seconds, and those that its cells say they took."""
    from pcdbench.runner.run import carry_out, local_processes

    its = planned(draws, rounds)
    out = folder / f"{draws} draws, {workers} workers, {time.monotonic_ns()}"
    # Completions of the run before must not be found.
    os.environ["PCDBENCH_CACHE"] = str(out / "cache")
    start = time.perf_counter()
    ended = carry_out(its, out, local_processes(workers))
    seconds = time.perf_counter() - start
    assert not ended.failed
    own = sum(row["completing"]["seconds"] + row["evaluating"]["seconds"] for row in ended.rows)
    return len(its.cells), seconds, own


def between(rounds: int, workers: int, folder: Path) -> tuple[float, float]:
    """Seconds a cell, and what cells say they took, in the midst of a run: starting and ending workers left out."""
    few_cells, few_seconds, few_own = elapsed(FEW, rounds, workers, folder)
    more_cells, more_seconds, more_own = elapsed(MORE, rounds, workers, folder)
    cells = more_cells - few_cells
    return (more_seconds - few_seconds) / cells, (more_own - few_own) / cells


def overhead(folder: Path) -> None:
    each, own = between(rounds_for(CELL_SECONDS), 1, folder)
    print(f"overhead: {1e3 * (each - own):.1f} ms a cell of {1e3 * own:.0f} ms: {each / own - 1:.1%} (at most 5 %)")


def workers(folder: Path) -> None:
    rounds = rounds_for(CELL_SECONDS)
    alone, together = (between(rounds, number, folder)[0] for number in RUN_WORKERS)
    print(f"workers: two are {alone / together:.2f} times as fast as one (at least 1.8), of {os.cpu_count()} cores")


def many(folder: Path) -> None:
    """Planning, resuming and summarising in a process of its own; its rows are written before."""
    from pcdbench.runner.rows import base_row, new_row
    from pcdbench.runner.store import RunStore

    its = planned(MANY["draws"], 0, MANY["scenes"], MANY_LEVELS, len(COMPLETERS))
    rng = np.random.default_rng(0)
    described = {"unit": "m", "direction": "lower", "summary": "median"}
    with RunStore(folder / "many", its.configuration, {}) as store:
        rows = []
        for cell in its.cells:
            row = new_row(base_row(its.dataset, cell, 1), cell, its.tasks[0])
            samples = rng.gamma(2.0, size=len(METRICS)).round(9)
            row["metrics"] = {
                name: described | {"main": name == METRICS[0], "samples": [float(value)]}
                for name, value in zip(METRICS, samples, strict=True)
            }
            row |= {"status": "ok", "completing": {"seconds": 0.1, "peak_memory_mb": 1.0, "cached": False}}
            rows.append(row)
            if len(rows) == 1000:
                store.append(rows)
                rows.clear()
    size = (folder / "many" / "rows.jsonl").stat().st_size
    del rows
    done = subprocess.run([sys.executable, __file__, "_many", folder], stdout=subprocess.PIPE, text=True, check=True)
    print(f"many: {len(its.cells):,} cells, {size / len(its.cells):,.0f} bytes a row: {done.stdout.strip()}")


def again(folder: Path) -> None:
    """What `many` measures: the same command, given again when all is done."""
    from pcdbench.leaderboard.summary import summarize
    from pcdbench.runner.run import carry_out, local_processes

    marks = [time.process_time()]
    its = planned(MANY["draws"], 0, MANY["scenes"], MANY_LEVELS, len(COMPLETERS))
    marks.append(time.process_time())
    ended = carry_out(its, folder / "many", local_processes(1))
    marks.append(time.process_time())
    assert ended.new_cells == 0 and len(summarize(ended.rows)) == len(METRICS) * len(MANY_LEVELS) * len(COMPLETERS)
    marks.append(time.process_time())
    plan_seconds, resume_seconds, summary_seconds = np.diff(marks)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    print(
        f"planned in {plan_seconds:.1f} s, resumed in {resume_seconds:.1f} s, summarised in {summary_seconds:.1f} s of "
        f"processor time, {marks[-1]:.1f} s with imports (at most 10), {peak:.0f} MB at its peak (at most 500)"
    )


@dataclass(frozen=True)
class Costs:
    """What a cell costs whoever all cells pass by, in seconds, and its row in bytes."""

    client: float
    scheduler: float
    syncing: float
    row_bytes: float


def dask(folder: Path) -> Costs:
    """Processor time a cell of the client's thread and of the scheduler's; the time of one synced append."""
    from pcdbench.runner.cluster import dask_cluster
    from pcdbench.runner.jobs import Job
    from pcdbench.runner.store import RunStore

    def thread_seconds() -> tuple[float, float]:
        loop = next(thread for thread in threading.enumerate() if "IO loop" in thread.name)
        clock = time.pthread_getcpuclockid(loop.ident or 0)
        return time.thread_time(), time.clock_gettime(clock)

    its = planned(100, 0)
    jobs = [Job(cell, its.tasks) for cell in its.cells]
    with dask_cluster(workers=2) as cluster, RunStore(folder / "dask", its.configuration, {}) as store:
        results = cluster.run(jobs, its.dataset)
        for _ in range(200):
            next(results)
        before = thread_seconds()
        rows = [rows for _, rows in results]
        after = thread_seconds()
        cells = len(rows)
        start = time.perf_counter()
        for its_rows in rows[:200]:
            store.append(its_rows)
        syncing = (time.perf_counter() - start) / 200
        size = (folder / "dask" / "rows.jsonl").stat().st_size / 200
    costs = Costs((after[0] - before[0]) / cells, (after[1] - before[1]) / cells, syncing, size)
    print(
        f"dask: {1e3 * costs.client:.2f} ms of the client and {1e3 * costs.scheduler:.2f} ms of the scheduler a cell "
        f"(processor time), {1e3 * costs.syncing:.2f} ms a synced append, {costs.row_bytes:,.0f} bytes a row"
    )
    return costs


@dataclass(frozen=True)
class Simulated:
    """How busy everyone was while a run lasted, as shares of its time."""

    workers: float
    client: float
    scheduler: float
    cells_a_second: float


def simulated(workers: int, cell_seconds: float, costs: Costs, cells_a_worker: int = 50, seed: int = 0) -> Simulated:
    """A run, event by event: cells of gamma-distributed length, two at each worker, one client and one scheduler.

    A finished cell passes the scheduler and the client, which stores its rows and sends the next one, which passes the
    scheduler again. Each serves one after the other; half of the scheduler's cost is counted each way.
    """
    rng = np.random.default_rng(seed)
    total = workers * cells_a_worker
    lengths = iter(rng.gamma(4.0, cell_seconds / 4.0, total).tolist())
    events: list[tuple[float, int, str, int]] = []
    order = count()
    free = {"client": 0.0, "back": 0.0}
    spent = {"client": 0.0, "scheduler": 0.0}
    waiting = [0] * workers
    busy = [False] * workers
    sent, worked, now = 0, 0.0, 0.0

    def at(moment: float, what: str, worker: int) -> None:
        heapq.heappush(events, (moment, next(order), what, worker))

    def serve(server: str, cost: float, queue: str) -> float:
        free[queue] = max(free[queue], now) + cost
        spent[server] += cost
        return free[queue]

    def begin(worker: int) -> None:
        nonlocal worked
        length = next(lengths)
        worked += length
        busy[worker] = True
        at(now + length, "finished", worker)

    for worker in [*range(workers), *range(workers)]:
        at(0.0, "at client", worker)
    stored = -2 * workers
    while events:
        now, _, what, worker = heapq.heappop(events)
        match what:
            case "at client":
                stored += 1
                ready = serve("client", costs.client + (costs.syncing if stored > 0 else 0.0), "client")
                if sent < total:
                    sent += 1
                    at(ready + NETWORK_SECONDS, "to worker", worker)
            case "to worker":
                at(serve("scheduler", costs.scheduler / 2, "back") + NETWORK_SECONDS, "at worker", worker)
            case "at worker":
                if busy[worker]:
                    waiting[worker] += 1
                else:
                    begin(worker)
            case "finished":
                at(serve("scheduler", costs.scheduler / 2, "back") + NETWORK_SECONDS, "at client", worker)
                busy[worker] = False
                if waiting[worker]:
                    waiting[worker] -= 1
                    begin(worker)
    end = max(now, *free.values())
    return Simulated(worked / (workers * end), spent["client"] / end, spent["scheduler"] / end, total / end)


def simulate(costs: Costs) -> None:
    print("| workers | seconds a cell | workers busy | client busy | scheduler busy | cells a second | MB/s of rows |")
    print("|--:|--:|--:|--:|--:|--:|--:|")
    for number in (10, 100, 1000):
        for seconds in (0.1, 1.0, 5.0, 30.0):
            its = simulated(number, seconds, costs)
            print(
                f"| {number:,} | {seconds:g} | {its.workers:.0%} | {its.client:.0%} | {its.scheduler:.0%} | "
                f"{its.cells_a_second:,.0f} | {its.cells_a_second * costs.row_bytes / 1e6:.2f} |"
            )
    limits = {"scheduler": 1 / costs.scheduler, "client": 1 / (costs.client + costs.syncing)}
    for who, limit in sorted(limits.items(), key=lambda one: one[1]):
        print(
            f"the {who} takes {limit:,.0f} cells a second: 1,000 workers are busy from {1000 / limit:.1f} s a cell on"
        )


def main(parts: Sequence[str]) -> None:
    if parts[:1] == ["_many"]:
        again(Path(parts[1]))
        return
    wanted = parts or ["overhead", "workers", "many", "dask", "simulate"]
    with installed() as folder:
        if "overhead" in wanted:
            overhead(folder)
        if "workers" in wanted:
            workers(folder)
        if "many" in wanted:
            many(folder)
        if "dask" in wanted or "simulate" in wanted:
            costs = dask(folder)
            if "simulate" in wanted:
                simulate(costs)


if __name__ == "__main__":
    main(sys.argv[1:])

"""Where tiles are completed: in this process, or in worker processes with a few tiles under way at a time."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from itertools import islice
from typing import TYPE_CHECKING, Any

from pebble import ProcessExpired, ProcessPool

from pcdbench.errors import PcdbenchError, PluginError, told
from pcdbench.threads import thread_count
from pcdbench.workers import begin_worker, remove_temporary, temporary_place

if TYPE_CHECKING:
    from pcdbench.completer import Completer
    from pcdbench.completion.tile_work import TileResult, TileTask
    from pcdbench.completion.tiles import Index
    from pcdbench.runner.selection import Plugin

Outcome = tuple["Index", "TileResult | Exception | None"]


def tile_outcomes(
    tasks: Iterable[tuple[Index, TileTask]], completer: Plugin | Completer, jobs: int
) -> Iterator[Outcome]:
    """Complete tiles and give each as soon as it is there: its result, or the error that it ended in.

    Tasks are drawn as they are needed, so that no more than `jobs` + 1 windows are in memory. Closing the iterator
    ends the workers.

    Args:
        tasks: each tile with its work.
        completer: built once a process.
        jobs: worker processes; 1 is this process.

    Raises:
        PcdbenchError: where the completer cannot be built in this process.
    """
    if jobs == 1:
        yield from _here(tasks, completer)
        return
    context = multiprocessing.get_context("spawn")
    temporary = temporary_place()
    arguments = (completer, max(1, thread_count() // jobs), temporary)
    pool = ProcessPool(jobs, initializer=_begin_worker, initargs=arguments, context=context)
    waiting = iter(tasks)
    running: dict[Future, Index] = {}
    try:
        while True:
            for tile, task in islice(waiting, jobs + 1 - len(running)):
                running[pool.schedule(_in_worker, args=(task,))] = tile
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), _outcome(future)
    finally:
        pool.stop()
        pool.join()
        remove_temporary(temporary)


def _here(tasks: Iterable[tuple[Index, TileTask]], completer: Plugin | Completer) -> Iterator[Outcome]:
    from pcdbench.completion.tile_work import tile_result

    built = _built(completer)
    for tile, task in tasks:
        try:
            outcome: TileResult | Exception | None = tile_result(task, built)
        except Exception as error:
            outcome = error
        except SystemExit as end:
            outcome = PluginError(told(end))
        yield tile, outcome


def _outcome(future: Future) -> TileResult | Exception | None:
    try:
        result: TileResult | None = future.result()
        return result
    except ProcessExpired as death:
        return RuntimeError(f"its process died (exit code {death.exitcode}): a crash in native code, or out of memory")
    except Exception as error:
        return error
    except SystemExit as end:
        return PluginError(told(end))


def _built(completer: Plugin | Completer) -> Any:
    from pcdbench.completer import Completer

    if isinstance(completer, Completer):
        return completer
    try:
        return completer.build()
    except (PcdbenchError, KeyboardInterrupt):
        raise
    except BaseException as error:
        # Its constructor is the plugin's own, which may raise anything.
        raise PluginError(f"completer {completer.name!r} cannot be built: {told(error)}") from error


_completer: Any = None


def _begin_worker(completer: Plugin | Completer, threads: int, temporary: str | None) -> None:
    global _completer
    begin_worker(threads, temporary=temporary)
    _completer = completer


def _in_worker(task: TileTask) -> TileResult | None:
    global _completer
    from pcdbench.completion.tile_work import tile_result

    _completer = _built(_completer)
    return tile_result(task, _completer)

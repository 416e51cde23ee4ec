"""Completers that work outside of this interpreter: a program in an environment of its own, or on another machine."""

from __future__ import annotations

import hashlib
import os
import re
import selectors
import shlex
import subprocess
import sys
import time
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from pydantic import Field

from pcdbench import options as plugin_options
from pcdbench.cloud import PointCloud
from pcdbench.completer import Completer
from pcdbench.errors import PcdbenchError, PluginError, Skipped
from pcdbench.formats import EXTENSIONS
from pcdbench.keys import digest, file_digest
from pcdbench.threads import environment, thread_count
from pcdbench.workers import temporary_folder

INCOMPLETE, COMPLETED, SEED = "{incomplete}", "{completed}", "{seed}"
_DONE, _FAILED, _SKIPPED = "done", "failed: ", "skipped: "
# They tell of this interpreter, and mislead another one.
_PYTHON_VARIABLES = ("PYTHONPATH", "PYTHONHOME", "PYTHONSAFEPATH", "VIRTUAL_ENV")
_SEEDS = 2**31  # what every library takes
_ENDING_SECONDS = 3.0
_LOOK_EVERY_SECONDS = 0.2
# As much as a pipe holds: one reading leaves nothing behind that was printed before.
_PIECE_BYTES = 65_536
_KEPT_BYTES = 8_000
_LONGEST_REASON = 500
_SETTLED_NS = 1_000_000_000
_TAG_DIGITS = 16
_SAY_A_SIZE = 100  # points
_TIMES_AS_LARGE = 3.0  # a completed cloud is the incomplete one and what it lacks; units and normalisations are more
_TAG = re.compile(rf"-([0-9a-f]{{{_TAG_DIGITS}}})(?![0-9a-f])")


class CommandCompleter(Completer):
    """A completer that is a program: it reads the incomplete cloud from a file and writes the completed one to another.

    The program needs neither pcdbench nor this Python. Subclass it and say which program it is::

        class Mine(pcdbench.CommandCompleter):
            command = ("/opt/envs/mine/bin/python", "/opt/mine/complete.py", "{incomplete}", "{completed}")

    A command with `{completed}` in it is started for each cloud. One without is started once a worker, so that it
    loads its network once, and told of each cloud by a line on its standard input: the two files and the seed, with
    tabs between. It answers by one line on its standard output, once the cloud is written: `done`, `skipped: REASON` or
    `failed: REASON`; other lines are passed over. What is started for each cloud may say `skipped: REASON` in its
    last line.

    It runs in a folder of its own, with as many threads as this process has (`OMP_NUM_THREADS`).

    Attributes:
        command: program and arguments, in one text or several, which no shell reads; `{incomplete}`, `{completed}` and
            `{seed}` stand for the two files and a number that decides every random draw.
        files: what the output depends on, the program's scripts and weights: results of other bytes are not reused.
        suffix: the format of both files; of those that `PointCloud.read` takes `.npz` alone is exact in colours.
    """

    command: str | Sequence[str | Path] = ()
    files: str | Path | Sequence[str | Path] = ()
    suffix: str = ".ply"
    # How much memory another process takes is not known here.
    costs = ("seconds",)

    def __init__(self, options: plugin_options.Options | None = None) -> None:
        super().__init__(options)
        self._program: _Program | None = None
        self._first: _Files | None = None  # its `files` as they were first

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        command = shlex.split(self.command) if isinstance(self.command, str) else [str(part) for part in self.command]
        if not command:
            raise PluginError(f"{type(self).__name__} names no program; set its `command`")
        seed = str(int(rng.integers(_SEEDS)))
        with temporary_folder() as folder:
            incomplete, completed = (str(Path(folder) / f"{name}{self.suffix}") for name in ("incomplete", "completed"))
            cloud.write(incomplete)
            if any(COMPLETED in part for part in command):
                values = {INCOMPLETE: incomplete, COMPLETED: completed, SEED: seed}
                _run([_filled(part, values) for part in command], folder)
            else:
                if self._program is None:
                    self._program = _Program(command)
                self._program.ask(incomplete, completed, seed)
            try:
                if not os.path.isfile(completed):
                    raise PluginError(f"{command[0]} says that it is done, and wrote no {Path(completed).name}")
                result = _in_frame(PointCloud.read(completed), cloud)
            except Exception:
                if self._program is not None:
                    self._program.stop()  # it may have said so too early, and answers to one cloud be those to another
                raise
        if self._first is not None and self._first.digest != self.weights_digest():
            raise PcdbenchError(f"the `files` of {type(self).__name__} have changed meanwhile; give the command again")
        return result

    def weights_digest(self) -> str | None:
        """That of `files`, or None where none are named; files of the same size and time are not read again."""
        paths = [Path(file) for file in ([self.files] if isinstance(self.files, str | Path) else self.files)]
        if not paths:
            return None
        try:
            states = [(status.st_size, status.st_mtime_ns) for status in (path.stat() for path in paths)]
            if self._first is not None and self._first.settled and self._first.states == states:
                return self._first.digest
            found = digest([file_digest(path) for path in paths])
        except OSError as error:
            raise PcdbenchError(
                f"{error.filename}, of {type(self).__name__}, cannot be read ({error.strerror}); check its `files`"
            ) from None
        if self._first is None:
            # What was written in this moment may be written again within what clocks of file systems tell apart.
            settled = all(time.time_ns() - written > _SETTLED_NS for _, written in states)
            self._first = _Files(states, found, settled)
        return found


@dataclass(frozen=True)
class _Files:
    """Sizes and times of files, their digest, and whether they had not just been written."""

    states: list[tuple[int, int]]
    digest: str
    settled: bool


class FolderCompleter(Completer):
    """A completer whose clouds were completed elsewhere, and lie in a folder.

    `pcdbench data export` writes the incomplete clouds of an experiment. Each is completed, by whatever and wherever,
    into a file of the same name (more may stand before or after it, and the format may be another one), and a run
    takes them from `folder`. Names hold a digest of the incomplete cloud, so that none is taken for another's. What
    completing cost is not known here, and left open.
    """

    class Options(plugin_options.Options):
        """Where the completed clouds are."""

        folder: str = Field("", description="the completed clouds, named as pcdbench data export named the incomplete")

    options: Options
    costs = ()

    def __init__(self, options: Options | None = None) -> None:
        super().__init__(options)
        self._completed = _by_tag(type(self).__name__, self.options.folder)
        self._digests: dict[str, str] = {}

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        tag = cloud_tag(cloud)
        path = self._completed.get(tag)
        if path is None:
            raise PcdbenchError(
                f"{self.options.folder} has no file with {tag} in its name, the digest of this incomplete cloud; "
                "complete it, or export the clouds of this run (pcdbench data export)"
            )
        completed = _in_frame(PointCloud.read(path), cloud)
        if self._digests and self._digests[tag] != file_digest(path):
            raise PcdbenchError(f"{path} has changed meanwhile; give the command again")
        return completed

    def weights_digest(self) -> str | None:
        """That of all completed clouds: when one of them changes, or another comes, they are measured anew."""
        self._digests = {tag: file_digest(path) for tag, path in self._completed.items()}
        return digest(sorted([tag, its] for tag, its in self._digests.items()))


def cloud_tag(cloud: PointCloud) -> str:
    """The first 16 digits of the SHA-256 of a cloud's coordinates and colours, to the last bit."""
    hashed = hashlib.sha256(cloud.points.astype("<f8").tobytes())
    if cloud.colors is not None:
        hashed.update(cloud.colors.astype("<f4").tobytes())
    return hashed.hexdigest()[:_TAG_DIGITS]


def _in_frame(completed: PointCloud, incomplete: PointCloud) -> PointCloud:
    """The completed cloud, which is about as large as the incomplete one and in its place.

    Raises:
        PluginError: where it is not: files say nothing of units, and methods normalise what they are given.
    """
    if not len(completed) or len(incomplete) < _SAY_A_SIZE:
        return completed
    # What nine tenths of the points span, so that strays do not count.
    (low, middle, high), (its_low, its_middle, its_high) = (
        np.quantile(cloud.points, (0.05, 0.5, 0.95), axis=0) for cloud in (incomplete, completed)
    )
    size_m, its_size_m = float(np.linalg.norm(high - low)), float(np.linalg.norm(its_high - its_low))
    away_m = float(np.linalg.norm(its_middle - middle))
    if size_m / _TIMES_AS_LARGE <= its_size_m <= size_m * _TIMES_AS_LARGE and away_m <= size_m:
        return completed
    raise PluginError(
        f"the completed cloud is {its_size_m:.3g} m large and lies {away_m:.3g} m from the incomplete one, which is "
        f"{size_m:.3g} m large; give it in metres and in the same frame (undo what the method normalises)"
    )


def _by_tag(who: str, folder: str) -> Mapping[str, Path]:
    """The files of a folder by the digest in their names."""
    if not folder:
        raise PcdbenchError(
            f"{who} needs the folder with its completed clouds: --option NAME.folder=DIR (see pcdbench data export)"
        )
    found: dict[str, Path] = {}
    try:
        paths = sorted(Path(os.path.expanduser(folder)).iterdir())
    except OSError as error:
        raise PcdbenchError(f"the completed clouds of {who} are not at {folder} ({error.strerror})") from None
    for path in paths:
        tags = _TAG.findall(path.name)
        # A file that is being written, or notes of the system about another one, are hidden and named like a cloud.
        if not tags or path.suffix.lower() not in EXTENSIONS or path.name.startswith(".") or not path.is_file():
            continue
        if tags[-1] in found:
            raise PcdbenchError(f"{path} and {found[tags[-1]].name} are of the same incomplete cloud; keep one of them")
        found[tags[-1]] = path
    if not found:
        raise PcdbenchError(
            f"no cloud in {folder} is named as pcdbench data export names them (…-{'0' * _TAG_DIGITS}.ply)"
        )
    return found


def _filled(part: str, values: Mapping[str, str]) -> str:
    for name, value in values.items():
        part = part.replace(name, value)
    return part


def _environment() -> dict[str, str]:
    ours = {name: value for name, value in os.environ.items() if name not in _PYTHON_VARIABLES}
    return environment(thread_count()) | ours


def _run(command: Sequence[str], folder: str) -> None:
    """Run a program to its end.

    Raises:
        Skipped: where it says so in its last line.
        PluginError: where it cannot be started or does not end well.
    """
    said = b""
    with _started(command, folder, stdin=subprocess.DEVNULL, stderr=subprocess.STDOUT) as process:
        try:
            for _, piece in _printed(process):
                _pass_on(piece)
                said = (said + piece)[-_KEPT_BYTES:]
            process.wait()
        except BaseException:
            process.kill()
            raise
    last = _last_line(said)
    if last.startswith(_SKIPPED):
        raise Skipped(last.removeprefix(_SKIPPED))
    if process.returncode:
        raise PluginError(f"{command[0]} {_ending(process.returncode)}: {last or 'it printed nothing'}")


class _Program:
    """A program that is told of cloud after cloud, and started again where it has ended."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = command
        self._process: subprocess.Popen[bytes] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy, in a worker say, starts a process of its own."""
        return _Program, (self._command,)

    def ask(self, incomplete: str, completed: str, seed: str) -> None:
        """Have a cloud completed.

        Raises:
            Skipped, PluginError: as it answers, or where it ends instead or cannot be started.
        """
        if self._process is not None and self._process.poll() is not None:
            self._end()
        process = self._process or self._start()
        try:
            self._require_silence(process)
            answer, said = _answer(process, f"{incomplete}\t{completed}\t{seed}\n")
        except BaseException:
            # Its answer would be taken for that to the next cloud.
            process.kill()
            self._end()
            raise
        if answer is None:
            code = self._end()
            said = said or "it wrote nothing to standard error"
            raise PluginError(f"{self._command[0]} {_ending(code)} before it answered: {said}")
        if answer.startswith(_SKIPPED):
            raise Skipped(answer.removeprefix(_SKIPPED))
        if answer.startswith(_FAILED):
            raise PluginError(f"{self._command[0]} failed: {answer.removeprefix(_FAILED)}")

    def stop(self) -> None:
        """End it; it is started again for the next cloud."""
        if self._process is not None:
            self._process.kill()
            self._end()

    def _require_silence(self, process: subprocess.Popen[bytes]) -> None:
        """Pass on what it printed since it answered.

        Raises:
            PluginError: where that is another answer, which would be taken for that to the next cloud.
        """
        assert process.stdout is not None
        waiting = b""
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            while selector.select(0) and (piece := os.read(process.stdout.fileno(), _PIECE_BYTES)):
                waiting += piece
        if any(_as_answer(line) is not None for line in re.split(rb"[\r\n]", waiting)):
            raise PluginError(
                f"{self._command[0]} answered twice to one cloud ({_last_line(waiting)}); let it print one answer, "
                "once the cloud is written"
            )
        _pass_on(waiting)

    def _start(self) -> subprocess.Popen[bytes]:
        folder = temporary_folder()
        try:
            process = _started(self._command, folder.name, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
        except PluginError:
            folder.cleanup()
            raise
        self._process = process
        self._finalize = weakref.finalize(self, _end_process, process, folder)
        return process

    def _end(self) -> int:
        """The exit code of the program, which is killed if need be."""
        assert self._process is not None
        process, self._process = self._process, None
        self._finalize()
        return process.returncode


def _answer(process: subprocess.Popen[bytes], question: str) -> tuple[str | None, str]:
    """The line that answers, None where the program ends instead, and the last line that it wrote to standard error."""
    assert process.stdin is not None
    with suppress(BrokenPipeError):  # it has ended, and what it printed says why
        process.stdin.write(os.fsencode(question))
    said = unfinished = b""
    for pipe, piece in _printed(process):
        if pipe is process.stderr:
            _pass_on(piece)
            said = (said + piece)[-_KEPT_BYTES:]
            continue
        *lines, unfinished = re.split(rb"[\r\n]", unfinished + piece)
        for line in lines:
            answer = _as_answer(line)
            if answer is not None:
                return answer, _last_line(said)
            _pass_on(line + b"\n")
        unfinished = unfinished[-_KEPT_BYTES:]
    return _as_answer(unfinished), _last_line(said)


def _as_answer(line: bytes) -> str | None:
    text = line.decode(errors="replace").strip()
    return text if text == _DONE or text.startswith((_SKIPPED, _FAILED)) else None


def _started(command: Sequence[str], folder: str, stdin: int, stderr: int) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(
            command, bufsize=0, cwd=folder, env=_environment(), stdin=stdin, stdout=subprocess.PIPE, stderr=stderr
        )
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PluginError(f"{command[0]} cannot be started ({reason}); check the completer's `command`") from None


def _printed(process: subprocess.Popen[bytes]) -> Iterator[tuple[IO[bytes], bytes]]:
    """What a program prints, as it comes, and by which pipe; up to the end of its standard output, or to its own.

    What it started, and did not end, may hold the pipes open for as long as it likes.
    """
    # What it said on standard error before it answered comes before the answer.
    pipes = [pipe for pipe in (process.stderr, process.stdout) if pipe is not None]
    with selectors.DefaultSelector() as selector:
        for pipe in pipes:
            selector.register(pipe, selectors.EVENT_READ)
        ended = False
        while not ended:
            ended = process.poll() is not None
            ready = [key.fileobj for key, _ in selector.select(0 if ended else _LOOK_EVERY_SECONDS)]
            for pipe in pipes:
                if pipe not in ready:
                    continue
                piece = os.read(pipe.fileno(), _PIECE_BYTES)
                if piece:
                    yield pipe, piece
                elif pipe is process.stdout:
                    return
                else:
                    selector.unregister(pipe)


def _pass_on(printed: bytes) -> None:
    sys.stderr.write(printed.decode(errors="replace"))
    sys.stderr.flush()


def _end_process(process: subprocess.Popen[bytes], folder: Any) -> None:
    """Let a program end, which has no more to read; kill it where it does not."""
    for pipe in (process.stdin, process.stdout, process.stderr):
        assert pipe is not None
        with suppress(OSError):
            pipe.close()
    try:
        process.wait(_ENDING_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    folder.cleanup()


def _ending(code: int) -> str:
    return f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}"


def _last_line(printed: bytes) -> str:
    lines = printed.decode(errors="replace").splitlines()
    return next((line.strip()[:_LONGEST_REASON] for line in reversed(lines) if line.strip()), "")

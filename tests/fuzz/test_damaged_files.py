"""Damaged and malicious files of every kind: read or refused in one line, within a bound of memory and time.

Files are read by a process of its own (fuzz_child.py), so that a crash of a native reader is a failure and not the end
of the tests. `corpus` holds what campaigns found (campaign.py); it only grows.
"""

import io
import json
import re
import shutil
import struct
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fuzz_mutations import damaged, e57_with_xml, mutated
from fuzz_parent import Reader
from fuzz_seeds import SEEDS
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

CORPUS = Path(__file__).with_name("corpus")
FOUND = sorted(path for path in CORPUS.rglob("*") if path.is_file())
# Torch takes long to load; its files have a test of their own.
QUICK = ("boxes", "cloud", "s3dis", "sequence")


@pytest.fixture(scope="module")
def reader() -> Iterator[Reader]:
    one = Reader()
    yield one
    one.close()


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], list[Path]]:
    """Valid files by target, written once."""
    made: dict[str, list[Path]] = {}

    def files(target: str) -> list[Path]:
        if target not in made:
            made[target] = SEEDS[target](tmp_path_factory.mktemp(target))
        return made[target]

    return files


@pytest.mark.parametrize("path", FOUND, ids=lambda path: path.relative_to(CORPUS).as_posix())
def test_what_campaigns_found(reader: Reader, tmp_path: Path, path: Path) -> None:
    # A campaign calls them DIGEST~NAME, or DIGEST~FOLDER~NAME, after the valid file among others that they were.
    name = path.name.partition("~")[2].replace("~", "/")
    if name:
        SEEDS[path.parent.name](tmp_path)
    copy = tmp_path / (name or path.name)
    assert not name or copy.is_file()
    shutil.copyfile(path, copy)
    assert reader.outcome(path.parent.name, copy).problem(copy) == ""


@pytest.mark.parametrize("target", QUICK)
def test_valid_files_are_read(reader: Reader, valid: Callable[[str], list[Path]], target: str) -> None:
    for path in valid(target):
        result = reader.outcome(target, path)
        assert (result.ended, result.problem(path)) == ("read", ""), path.name


def test_mutated_files(reader: Reader, valid: Callable[[str], list[Path]]) -> None:
    ended = [how for target in QUICK for how in endings_of_mutated(reader, target, valid(target), 3)]
    # Neither are all mutations harmless, nor are they all found at the first look.
    assert ended.count("read") > 5 and ended.count("refused") > 20


@pytest.mark.parametrize("target", ["suite", "run", "build", "board"])
def test_mutated_suites_runs_and_boards(reader: Reader, valid: Callable[[str], list[Path]], target: str) -> None:
    for path in valid(target):
        result = reader.outcome(target, path)
        assert (result.ended, result.problem(path)) == ("read", ""), path.name
    ended = endings_of_mutated(reader, target, valid(target), 30)
    assert "read" in ended and "refused" in ended


def endings_of_mutated(reader: Reader, target: str, files: list[Path], times: int) -> list[str]:
    """How mutations of valid files ended, some of each; all of them as they should."""
    ended: list[str] = []
    seeds = [(path, path.read_bytes()) for path in files]
    others = [data for _, data in seeds]

    @settings(
        max_examples=times * len(seeds),
        derandomize=True,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.sampled_from(seeds), st.integers(0, 2**32))
    def check(seed: tuple[Path, bytes], number: int) -> None:
        path, data = seed
        path.write_bytes(damaged(path, data, np.random.default_rng(number), others))
        result = reader.outcome(target, path)
        problem = result.problem(path)
        path.write_bytes(data)
        assert problem == "", (path.name, number)
        ended.append(result.ended)

    check()
    return ended


def npz(**arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def lzma_npz() -> bytes:
    stream = io.BytesIO()
    array = io.BytesIO()
    np.save(array, np.zeros((10, 3)))
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("points.npy", array.getvalue())
    return stream.getvalue()


def numbers(data: bytes, pattern: bytes, value: bytes) -> bytes:
    changed, count = re.subn(pattern, value, data, count=1)
    assert count == 1
    return changed


def large_layer(data: bytes) -> bytes:
    """The first layer of a LAZ 1.4 file promises 4 GB."""
    (points_at,) = struct.unpack_from("<I", data, 96)
    (point_bytes,) = struct.unpack_from("<H", data, 105)
    at = points_at + 8 + point_bytes + 4
    return data[:at] + struct.pack("<I", 2**32 - 1) + data[at + 4 :]


HEADER = b"ply\nformat %s 1.0\nelement vertex 1000000000000\n" + b"".join(
    b"property float %c\n" % its for its in b"xyz"
)
PCD = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1000000000000\nDATA "
ENTITIES = b"<!DOCTYPE e57Root [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'>]>"

PROMISES: dict[str, Callable[[Callable[[str], bytes]], bytes]] = {
    "binary.ply": lambda _: HEADER % b"binary_little_endian" + b"end_header\n" + bytes(120),
    "ascii.ply": lambda _: HEADER % b"ascii" + b"end_header\n1 2 3\n",
    "elements.ply": lambda _: b"ply\nformat ascii 1.0\n" + b"element x 999999999999999\n" * 20000,
    "binary.pcd": lambda _: PCD + b"binary\n" + bytes(120),
    "ascii.pcd": lambda _: PCD + b"ascii\n1 2 3\n",
    "packed.pcd": lambda _: PCD + b"binary_compressed\n" + struct.pack("<II", 8, 2**32 - 1) + bytes(8),
    "wide.pcd": lambda _: PCD.replace(b"COUNT 1 1 1", b"COUNT 1 1 999999999") + b"binary\n" + bytes(120),
    "digits.xyz": lambda _: b"1" * 3_000_000,
    "zeros.npz": lambda _: npz(points=np.zeros((1_200_000, 3), np.int8)),
    "lzma.npz": lambda _: lzma_npz(),
    "pickle.npz": lambda _: npz(points=np.array([[object(), 1, 2]], dtype=object)),
    "layer.laz": lambda valid: large_layer(valid("layered.laz")),
    "count.laz": lambda valid: valid("layered.laz")[:247] + struct.pack("<Q", 10**12) + valid("layered.laz")[255:],
    "count.las": lambda valid: valid("layered.las")[:247] + struct.pack("<Q", 10**12) + valid("layered.las")[255:],
    "count.e57": lambda valid: e57_with_xml(
        valid("plain.e57"), lambda xml: numbers(xml, rb'recordCount="\d+"', b'recordCount="1000000000000"')
    ),
    "entities.e57": lambda valid: e57_with_xml(
        valid("plain.e57"), lambda xml: xml.replace(b"<e57Root", ENTITIES + b"<e57Root").replace(b"cloud", b"&b;")
    ),
    "deep.e57": lambda valid: e57_with_xml(
        valid("plain.e57"), lambda xml: xml.replace(b"</e57Root>", b"<a>" * 50_000 + b"</a>" * 50_000 + b"</e57Root>")
    ),
    "deep.boxes.json": lambda _: b"[" * 100_000,
    "large.boxes.json": lambda _: b'[{"label": "a", "min": [0, 0, 0], "max": [1' + b"0" * 400 + b", 1, 1]}]",
}


@pytest.mark.parametrize("name", PROMISES)
def test_promises_that_no_file_of_this_size_keeps(
    reader: Reader, valid: Callable[[str], list[Path]], tmp_path: Path, name: str
) -> None:
    path = tmp_path / name
    path.write_bytes(PROMISES[name](lambda of: next(its for its in valid("cloud") if its.name == of).read_bytes()))
    result = reader.outcome("boxes" if name.endswith(".json") else "cloud", path)
    assert (result.ended, result.problem(path)) == ("refused", "")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("run.json", "[" * 100_000),
        ("run.json", '{"schema_version": "1"}'),
        ("run.json", '{"schema_version": 1, "configuration": []}'),
        ("rows.jsonl", "[" * 100_000 + "\n"),
        ("rows.jsonl", '{"key": "a"}\n'),
        ("rows.jsonl", '{"key": ["a"]}\n'),
        ("rows.jsonl", {"completer": {"name": "mine"}}),
        ("rows.jsonl", {"metrics": {"chd": {"samples": [1]}}}),
        ("rows.jsonl", {"level": 10**400}),
        ("rows.jsonl", {"missing": "much"}),
        ("rows.jsonl", {"completing": {"seconds": []}}),
    ],
)
def test_runs_of_strangers(reader: Reader, tmp_path: Path, name: str, content: str | dict) -> None:
    SEEDS["run"](tmp_path)
    path = tmp_path / name
    if isinstance(content, dict):
        first, *rest = path.read_text().splitlines()
        content = "\n".join([json.dumps(json.loads(first) | content), *rest, ""])
    path.write_text(content)
    result = reader.outcome("run", path)
    assert (result.ended, result.problem(path)) == ("refused", "")


@pytest.mark.parametrize(
    "change",
    [
        lambda row: row.pop("dataset"),
        lambda row: row["dataset"].update(version=2),
        lambda row: row["task"].update(version=""),
        lambda row: row["completer"].pop("options"),
        lambda row: row["completer"].update(weights=1),
        lambda row: row.update(key="../../x"),
        lambda row: row.update(status="fine"),
        lambda row: row.update(draw=10**12),
    ],
)
def test_boards_of_strangers_rows(reader: Reader, tmp_path: Path, change: Callable[[dict], None]) -> None:
    path = SEEDS["build"](tmp_path)[0]
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    change(rows[3])
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    result = reader.outcome("build", path)
    assert (path.name, result.ended, result.problem(path)) == ("rows.jsonl", "refused", "")


@pytest.mark.parametrize(
    "change",
    [
        {"configuration": {"split": 3}},
        {"configuration": {"split": "test", "dataset": ["rooms"]}},
        {"configuration": {"split": "test", "completers": [{"name": "mine"}]}},
        {"machine": {"cpu": float("nan")}},
        {"calibration_seconds": -1},
        {"time": 5},
        {"elsewhere": {"h": {"calibration_seconds": -1}}},
        {"elsewhere": ["h"]},
    ],
)
def test_boards_of_strangers_runs(reader: Reader, tmp_path: Path, change: dict) -> None:
    path = SEEDS["build"](tmp_path)[1]
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    result = reader.outcome("build", path)
    assert (path.name, result.ended, result.problem(path)) == ("run.json", "refused", "")


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (["cells", 0, "case"], 99),
        (["cells", 0, "case"], -1),
        (["cells", 0, "run"], 1),
        (["cells", 0, "completer"], "another"),
        (["cases", 0, "scene"], "another"),
        (["cases", 0, "level"], "high"),
        (["cases", 0, "level"], float("inf")),
        (["standings", 0, "median"], [1, 2]),
        (["tasks", 0, "metrics"], []),
        (["schema_version"], "1"),
        (["schema_version"], 0),
    ],
)
def test_boards_that_lie(reader: Reader, tmp_path: Path, place: list, value: object) -> None:
    (path,) = SEEDS["board"](tmp_path)
    content = holder = json.loads(path.read_text())
    for part in place[:-1]:
        holder = holder[part]
    holder[place[-1]] = value
    path.write_text(json.dumps(content))
    result = reader.outcome("board", path)
    assert (result.ended, result.problem(path)) == ("refused", "")


def test_weights_and_checkpoints(reader: Reader, valid: Callable[[str], list[Path]]) -> None:
    for target in ("weights", "checkpoint"):
        for path in valid(target):
            data = path.read_bytes()
            assert reader.outcome(target, path).ended == "read"
            rng = np.random.default_rng(0)
            lies = [struct.pack("<Q", 2**60) + data[8:], struct.pack("<Q", 100_000) + b"[" * 100_000, data[:100]]
            for changed in [*lies, *(mutated(data, rng) for _ in range(8))]:
                path.write_bytes(changed)
                problem = reader.outcome(target, path).problem(path)
                path.write_bytes(data)
                assert problem == ""

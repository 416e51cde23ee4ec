"""What a worker printed: its end, whatever its length."""

import os
import subprocess
import sys

import pytest

from pcdbench.runner.measuring import resident_bytes
from pcdbench.runner.output import Output, clear


def test_the_end_is_kept_in_lines_and_letters():
    output = Output()
    descriptor = output.handle.fileno()
    assert output.last_lines() is None
    os.write(descriptor, b"\n".join(f"line {number}".encode() for number in range(100)) + b"\n\xff\n")
    assert output.last_lines().splitlines() == [*(f"line {number}" for number in range(61, 100)), "\ufffd"]
    os.write(descriptor, b"x" * 50_000)
    assert output.last_lines() == "x" * 8_000
    clear(descriptor)
    os.write(descriptor, b"Extension modules: numpy\nnew\n")
    assert output.last_lines() == "new"


def test_what_is_too_long_loses_its_beginning_while_it_is_still_written():
    output = Output()
    writer = os.dup(output.handle.fileno())
    for number in range(3000):
        os.write(writer, f"{number:999}\n".encode())
        output.clip()
    assert os.fstat(writer).st_size <= 1_001_000
    assert output.last_lines().splitlines()[-1].strip() == "2999"
    os.close(writer)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux tells what processes hold")
def test_memory_of_a_process_counts_its_children():
    grown = "import sys; held = bytearray(b'x' * 50_000_000); print('held', flush=True); sys.stdin.read()"
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {grown!r}])"
    with subprocess.Popen([sys.executable, "-c", parent], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        assert 50e6 < resident_bytes(process.pid) < 150e6
        process.stdin.close()
    assert resident_bytes(process.pid) == 0

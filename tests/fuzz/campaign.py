"""Mutates files for as long as you like and keeps those that are read wrongly: python tests/fuzz/campaign.py --help."""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from fuzz_mutations import damaged
from fuzz_parent import Reader
from fuzz_seeds import SEEDS


def main() -> None:
    """Print what was found and how many files were tried; files that were read wrongly go to --out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="file names that hold this, say .laz")
    parser.add_argument("--target", default="", help=f"one of {' '.join(SEEDS)}; all unless given")
    parser.add_argument("--out", type=Path, default=Path("fuzz-findings"))
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    reader, tried, found = Reader(), Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as made:
        seeds = []
        for target, make in SEEDS.items():
            if arguments.target not in target:
                continue
            folder = Path(made, target)
            folder.mkdir()
            seeds += [(target, path, path.read_bytes()) for path in make(folder) if arguments.only in path.name]
        for target, path, _ in seeds:
            assert reader.outcome(target, path).ended == "read", path
        others = [data for _, _, data in seeds]
        end = time.monotonic() + 60 * arguments.minutes
        while time.monotonic() < end:
            target, path, data = seeds[int(rng.integers(len(seeds)))]
            changed = damaged(path, data, rng, others)
            path.write_bytes(changed)
            result = reader.outcome(target, path)
            path.write_bytes(data)
            name = path.relative_to(Path(made, target)).as_posix().replace("/", "~")
            tried[f"{target}/{name} {result.ended}"] += 1
            problem = result.problem(path)
            kind = f"{target}/{name}: {problem.strip().splitlines()[-1][:110]}" if problem else ""
            if problem and found[kind] < 3:
                kept = arguments.out / target / f"{hashlib.sha256(changed).hexdigest()[:8]}~{name}"
                kept.parent.mkdir(parents=True, exist_ok=True)
                kept.write_bytes(changed)
                print(f"{kept}: {problem}", flush=True)
            found[kind] += bool(problem)
    reader.close()
    print(f"{tried.total():,} files; {sum(found.values())} read wrongly, in {len(+found)} ways")
    for kind, count in sorted(tried.items()):
        print(f"  {count:7,} {kind}")
    sys.exit(bool(+found))


if __name__ == "__main__":
    main()

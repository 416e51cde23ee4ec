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
from fuzz_mutations import mutated, mutated_e57
from fuzz_parent import Reader
from fuzz_seeds import valid_boxes, valid_clouds


def main() -> None:
    """Print what was found and how many files were tried; files that were read wrongly go to --out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="file names that hold this, say .laz")
    parser.add_argument("--out", type=Path, default=Path("fuzz-findings"))
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    reader, tried, found = Reader(), Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as made:
        seeds = []
        for target, make in (("cloud", valid_clouds), ("boxes", valid_boxes)):
            folder = Path(made, target)
            folder.mkdir()
            seeds += [(target, path, path.read_bytes()) for path in make(folder) if arguments.only in path.name]
        for target, path, _ in seeds:
            assert reader.outcome(target, path).ended == "read", path
        others = [data for _, _, data in seeds]
        end = time.monotonic() + 60 * arguments.minutes
        while time.monotonic() < end:
            target, seed_path, data = seeds[int(rng.integers(len(seeds)))]
            path = Path(made, f"damaged{''.join(seed_path.suffixes)}")
            mutate = mutated_e57 if seed_path.suffix == ".e57" and rng.random() < 0.9 else mutated
            changed = mutate(data, rng, others)
            path.write_bytes(changed)
            result = reader.outcome(target, path)
            tried[f"{seed_path.name} {result.ended}"] += 1
            problem = result.problem(path)
            kind = f"{seed_path.name}: {problem.strip().splitlines()[-1][:110]}" if problem else ""
            if problem and found[kind] < 3:
                arguments.out.mkdir(parents=True, exist_ok=True)
                name = f"{target}-{seed_path.stem}-{hashlib.sha256(changed).hexdigest()[:8]}{''.join(path.suffixes)}"
                (arguments.out / name).write_bytes(changed)
                print(f"{name}: {problem}", flush=True)
            found[kind] += bool(problem)
    reader.close()
    print(f"{tried.total():,} files; {sum(found.values())} read wrongly, in {len(+found)} ways")
    for kind, count in sorted(tried.items()):
        print(f"  {count:7,} {kind}")
    sys.exit(bool(+found))


if __name__ == "__main__":
    main()

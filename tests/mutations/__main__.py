"""Put small faults into the mathematics, one at a time, and see whether the tests find them.

    uv run --group dev python tests/mutations              # all forty, about an hour
    uv run --group dev python tests/mutations --only qp/   # those in files with this in the path
    uv run --group dev python tests/mutations --nearest    # the nearest tests alone

Each fault is put into a copy of the tree. Its nearest tests run first, then the whole default
suite. Exit code 1 if more than `--may-survive` are left.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from faults import FAULTS, Fault

ROOT = Path(__file__).parents[2]
MAY_SURVIVE = 2  # of forty
FOUND, SURVIVED = "found", "SURVIVED"


def main() -> int:
    """Try the faults and report each."""
    flags = _flags()
    chosen = [fault for fault in FAULTS if flags.only in fault.file]
    for fault in chosen:
        faulty_text(fault)  # an anchor that is gone is told before anything runs
    if not sound_without(chosen):
        print("the nearest tests fail without a fault: mend that first")
        return 2
    survivors = []
    for number, fault in enumerate(chosen, start=1):
        begun = time.monotonic()
        outcome = tried(fault, flags.nearest)
        if outcome == SURVIVED:
            survivors.append(fault)
        seconds = time.monotonic() - begun
        print(
            f"{number:3d}/{len(chosen)}  {outcome:<22} {seconds:5.0f} s  "
            f"{fault.file}: {fault.becomes}",
            flush=True,
        )
    print(f"found {len(chosen) - len(survivors)} of {len(chosen)}")
    return int(len(survivors) > flags.may_survive)


def faulty_text(fault: Fault) -> str:
    """The file of a fault with the fault in it."""
    return fault.put_into((ROOT / fault.file).read_text())


def sound_without(faults: list[Fault]) -> bool:
    """Whether the nearest tests pass in a copy without a fault."""
    nearest = sorted({fault.tests for fault in faults})
    with tempfile.TemporaryDirectory() as folder:
        return _passes(_copied(Path(folder) / "tree"), *nearest)


def tried(fault: Fault, nearest_only: bool) -> str:
    """Which tests fail with the fault in the tree: the nearest, others, or none."""
    with tempfile.TemporaryDirectory() as folder:
        tree = _copied(Path(folder) / "tree")
        (tree / fault.file).write_text(faulty_text(fault))
        if not _passes(tree, "-n", "0", fault.tests):
            return f"{FOUND} at once"
        if nearest_only or _passes(tree):
            return SURVIVED
        return f"{FOUND} by others"


def _passes(tree: Path, *arguments: str) -> bool:
    environment = {
        **os.environ,
        "PYTHONPATH": str(tree),  # before the installed packages
        "PYTHONDONTWRITEBYTECODE": "1",
        "NUMBA_CACHE_DIR": str(tree.parent / "numba"),  # it knows files by size and time only
    }
    command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", *arguments]
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True)
    if done.returncode not in (0, 1, 2):  # a test failed, or a file of tests at its import
        raise RuntimeError(f"{' '.join(command)}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.returncode == 0


def _copied(tree: Path) -> Path:
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in filter(None, listed.stdout.split("\0")):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, tree / name)
    return tree


def _flags() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tests/mutations", description=__doc__)
    parser.add_argument("--only", default="", help="part of the path of the files to put faults in")
    parser.add_argument("--nearest", action="store_true", help="run the nearest tests alone")
    parser.add_argument("--may-survive", type=int, default=MAY_SURVIVE)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())

"""Fuzz every reader of foreign bytes, guided by coverage: only its errors, in bounded time and memory.

    python bench/fuzz.py
    python bench/fuzz.py cpf indi --seconds 600
    python bench/fuzz.py cpf --again FILE

This needs atheris, which is no dependency of sattrack: `pip install atheris`. Each of `fuzz_readers.py`
runs in a process of its own, by libFuzzer, from small valid examples. A crash is what it raises beside its
documented errors, or an input that takes too long or too much memory. The input is kept, and the command that
runs it again is printed. Branches and features are libFuzzer's counts (a feature: a branch, and how often).
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import os
import re
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import NamedTuple

from fuzz_readers import READERS, Reader, found

KEPT = Path(__file__).resolve().parent.parent / "build" / "fuzz"
MEMORY = Path("/dev/shm")
LONGEST_S, MOST_MB = 5, 2048
AFTER_S = 120.0
"""A process that has not ended so long after its time hangs."""
CRASHED = re.compile(r"Test unit written to (\S+)")
REACHED = re.compile(r"^#(\d+)\s.*cov: (\d+) ft: (\d+)", re.MULTILINE)
TRIED = re.compile(r"stat::number_of_executed_units: (\d+)")
RAISED = re.compile(r"Uncaught Python exception: ===\n(.*)")


class Result(NamedTuple):
    """What came of one reader's time."""

    tried: int
    branches: int
    features: int
    crash: Path | None
    why: str


def be_the_child(name: str, arguments: list[str]) -> None:
    """Fuzz one reader in this process, by libFuzzer's own arguments."""
    import atheris

    reader = READERS[name]
    with atheris.instrument_imports(include=["sattrack", "tle"]):
        reads = reader.make()
        errors = tuple(found(one) for one in reader.errors)
    # As in the tests: a warning is a defect.
    warnings.simplefilter("error")

    def try_one(data: bytes) -> None:
        for read in reads:
            try:
                read(data)
            except errors:
                continue
            except Exception:
                # As libFuzzer does, which now and then does not.
                kept = Path(f"{KEPT / name}-crash-{hashlib.sha1(data).hexdigest()}")
                kept.write_bytes(data)
                print(f"Test unit written to {kept}", flush=True)
                raise

    atheris.Setup([sys.argv[0], *arguments], try_one)
    atheris.Fuzz()


def run(name: str, arguments: list[str], folder: Path, within_s: float | None) -> str:
    """Run a child; return what libFuzzer said."""
    command = [sys.executable, __file__, "--child", name, *arguments]
    environment = {**os.environ, "TMPDIR": str(folder), "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=within_s,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired as late:
        return (late.stdout or b"").decode(
            errors="replace"
        ) + "\n=== Uncaught Python exception: ===\nit hangs\n"
    return done.stdout.decode(errors="replace")


def limits(reader: Reader) -> list[str]:
    return [f"-timeout={LONGEST_S}", f"-rss_limit_mb={MOST_MB}", f"-max_len={reader.most_bytes}"]


def fuzz(name: str, seconds: float, seed: int) -> Result:
    """Fuzz one reader for a time."""
    reader = READERS[name]
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as made:
        folder = Path(made)
        corpus = folder / "corpus"
        corpus.mkdir()
        for k, example in enumerate(reader.seeds):
            (corpus / str(k)).write_bytes(example if isinstance(example, bytes) else example())
        said = run(
            name,
            [
                *limits(reader),
                f"-max_total_time={seconds:.0f}",
                f"-seed={seed}",
                f"-artifact_prefix={KEPT / name}-",
                "-print_final_stats=1",
                str(corpus),
            ],
            folder,
            seconds + AFTER_S,
        )
    reached = REACHED.findall(said)
    tried, crash, raised = TRIED.search(said), CRASHED.search(said), RAISED.search(said)
    if not reached or (tried is None and raised is None):
        return Result(0, 0, 0, None, "it did not run: " + " ".join(said.split())[-300:])
    _, branches, features = reached[-1]
    why = raised[1] if raised else f"more than {LONGEST_S} s or {MOST_MB} MB" if crash else ""
    count = int(tried[1]) if tried else int(reached[-1][0])
    return Result(count, int(branches), int(features), Path(crash[1]) if crash else None, why)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").partition("\n")[0], epilog=f"Readers: {', '.join(READERS)}."
    )
    parser.add_argument(
        "reader", nargs="*", choices=[*READERS, []], metavar="READER", help="which readers; default: all"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="for each reader")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--again", metavar="FILE", help="run one kept input of one reader again")
    options = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        sys.exit("fuzz.py needs atheris: run `pip install atheris`")
    names = options.reader or list(READERS)
    KEPT.mkdir(parents=True, exist_ok=True)
    if options.again is not None:
        with tempfile.TemporaryDirectory() as folder:
            print(run(names[0], [*limits(READERS[names[0]]), options.again], Path(folder), None))
        return 0
    print("| reader | reads | inputs tried | branches | features | crashes |\n|---|---|---|---|---|---|")
    crashes = []
    for name in names:
        result = fuzz(name, options.seconds, options.seed)
        print(
            f"| `{name}` | {READERS[name].reads} | {result.tried} | {result.branches} | {result.features} "
            f"| {int(bool(result.why))} |",
            flush=True,
        )
        if result.why:
            again = f": python bench/fuzz.py {name} --again {result.crash}" if result.crash else ""
            crashes.append(f"{name}: {result.why}{again}")
            print(crashes[-1], file=sys.stderr, flush=True)
    return 1 if crashes else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        be_the_child(sys.argv[2], sys.argv[3:])
    sys.exit(main())

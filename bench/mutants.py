"""Change the code in small ways, and see whether the tests notice.

    python bench/mutants.py safety --sample 150
    python bench/mutants.py safety --lines
    python bench/mutants.py biases --sample 0 --needed

A mutant is one small change of one expression or statement: a comparison turned round, another sign, number
or operator, a call, a returned value or a row of a table left out. It is caught if a test of its package
fails or hangs. Of the package's tests those run that execute the changed statement, the quickest and those
in the module's own file first, `--budget` seconds in all. Coverage tells which, and what it tells is kept in
a temporary folder until source or test changes. Each mutant runs in a process forked from one that has
imported the libraries. Annotations, decorators and texts are left alone, and what makes no difference:
`strict` of a zip, None in place of False. `--lines` counts what the tests' own processes execute, too.
With `--needed` the tests that have caught a mutant before come first, and at the end those are named that
caught none: as many mutants are caught without them. What such a test says of texts, and of what no mutant
changes, remains to be looked at.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import fcntl
import gzip
import hashlib
import importlib.abc
import importlib.util
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import coverage
import hypothesis
import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from types import ModuleType

ROOT = Path(__file__).resolve().parent.parent
LIBRARIES = ("numpy", "msgspec", "erfa", "sgp4.api", "skyfield.api", "click", "mcap", "astropy_iers_data")
OWN_COUNT = 0.2
"""As so much of their time the tests in a module's own file count, where the quickest come first."""
TIMES_LONGER, LONGER_S, WAITS = 5.0, 20.0, 10.0
"""A mutant hangs if its tests take so many times the processor's time that they did, and so much more, or
wait so many times as long."""
MOST_WRITTEN = 1 << 20


class Package(NamedTuple):
    """What is changed, and the tests that must notice."""

    sources: tuple[str, ...]
    tests: tuple[str, ...]


IN_VIRTUAL_TIME = (
    "armed_pass", "bias_memory", "cut_short_slews", "followed_targets", "late_datagrams", "learnt_gears",
    "learnt_mount", "paused_pass", "strange_statuses", "trouble", "virtual_pass",
)  # fmt: skip
"""Runs of `tests/sattrack/runtime` that no busy machine makes late: what fails then is no change noticed."""
PACKAGES = {
    "safety": Package(("sattrack/safety/*.py",), ("tests/sattrack/safety",)),
    "control": Package(
        ("sattrack/control/*.py",),
        (
            "tests/sattrack/control",
            "tests/sattrack/recording",
            *(f"tests/sattrack/runtime/test_{name}.py" for name in IN_VIRTUAL_TIME),
        ),
    ),
    "session": Package(("sattrack/mount/xerxes/*.py",), ("tests/sattrack/mount/xerxes",)),
    "biases": Package(
        ("tle/bias.py", "tle/observed.py"), ("tests/tle/test_bias.py", "tests/tle/test_turns_and_places.py")
    ),
    "schedule": Package(
        ("sattrack/schedule/machine.py", "sattrack/schedule/conditions.py", "sattrack/schedule/night.py"),
        ("tests/sattrack/schedule/test_night_machine.py", "tests/sattrack/schedule/test_night_harm.py"),
    ),
    "tle": Package(
        ("tle/*.py", "tle/formats/*.py"),
        (
            "tests/tle",
            "tests/sattrack/planning",
            "tests/sattrack/control/test_bias_estimate.py",
            "tests/sattrack/control/test_seen_offsets.py",
        ),
    ),
    "schedules": Package(("sattrack/schedule/*.py",), ("tests/sattrack/schedule",)),
}
COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.GtE, ast.LtE), ast.LtE: (ast.Gt, ast.Lt), ast.Gt: (ast.LtE, ast.GtE),
    ast.GtE: (ast.Lt, ast.Gt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
"""The first turns a comparison round. The second moves its bound: of counts only, as angles and seconds do
not meet a bound to the last bit."""
COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv, ast.Pow: ast.Mult, ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.MatMult: ast.Mult,
}  # fmt: skip
NOT_CODE, FROZEN = frozenset({"annotation", "returns", "decorator_list"}), (ast.ClassDef, "keywords")


class Mutant(NamedTuple):
    """One change: what is put into a field of the node of that number in a file, or a place of the field."""

    path: str
    node: int
    field: str
    place: int | None
    put: ast.AST
    line: int
    change: str

    @property
    def where(self) -> str:
        return f"{self.path}:{self.line}: {self.change}"

    def tree(self) -> ast.Module:
        """Return the file's syntax tree with the change."""
        tree = ast.parse((ROOT / self.path).read_text())
        holder = _nodes(tree)[self.node]
        put = [] if isinstance(self.put, ast.Delete) else [copy.deepcopy(self.put)]
        if self.place is None:
            setattr(holder, self.field, put[0])
        else:
            getattr(holder, self.field)[self.place : self.place + 1] = put
        return ast.fix_missing_locations(tree)


def mutants_of(path: str) -> list[Mutant]:
    """Return every mutant of a file."""
    found = []
    for number, node in enumerate(_nodes(ast.parse((ROOT / path).read_text()))):
        stored = isinstance(node, ast.Subscript) and not isinstance(node.ctx, ast.Load)
        if stored or isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom):
            continue
        for field, value in ast.iter_fields(node):
            for place, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
                if isinstance(child, ast.AST) and field not in NOT_CODE:
                    line = getattr(child, "lineno", getattr(node, "lineno", 0))
                    for put in _instead(node, field, child):
                        text = "-" if isinstance(put, ast.Delete) else _text(put)
                        change = f"{_text(child)} → {text}"
                        found.append(Mutant(path, number, field, place, put, line, change))
    return found


def _nodes(tree: ast.AST) -> list[ast.AST]:
    """Return the nodes where something may be changed, in a fixed order."""
    found, left = [], [tree]
    while left:
        node = left.pop()
        if isinstance(node, ast.If) and _text(node.test) == "TYPE_CHECKING":
            continue
        found.append(node)
        for field, value in ast.iter_fields(node):
            if (
                field not in NOT_CODE
                and not isinstance(node, ast.JoinedStr)
                and (type(node), field) != FROZEN
            ):
                each = value if isinstance(value, list) else [value]
                left += [one for one in each if isinstance(one, ast.AST)]
    return found


def _text(node: ast.AST) -> str:
    with contextlib.suppress(Exception):
        return " ".join(ast.unparse(node).split())[:90]
    return type(node).__name__


def _is_count(node: ast.expr) -> bool:
    """Tell whether something is a whole number written out, or a length."""
    is_number = isinstance(node, ast.Constant) and type(node.value) is int
    return is_number or (isinstance(node, ast.Call) and _text(node.func) == "len")


def _instead(parent: ast.AST, field: str, node: ast.AST) -> Iterator[ast.AST]:
    """Yield what may stand in a node's place."""
    match node:
        case ast.Compare():
            for k, each in enumerate(node.ops):
                counts = any(map(_is_count, [node.left, *node.comparators][k : k + 2]))
                for other in COMPARED[type(each)][: 2 if counts else 1]:
                    ops = [*node.ops[:k], other(), *node.ops[k + 1 :]]
                    yield ast.Compare(node.left, ops, node.comparators)
        case ast.BinOp() if type(node.op) in COMPUTED:
            yield ast.BinOp(node.left, COMPUTED[type(node.op)](), node.right)
        case ast.AugAssign() if type(node.op) in COMPUTED:
            yield ast.AugAssign(node.target, COMPUTED[type(node.op)](), node.value)
        case ast.BoolOp():
            yield ast.BoolOp(ast.And() if isinstance(node.op, ast.Or) else ast.Or(), node.values)
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            yield node.operand
        case ast.Constant(value=bool()):
            if not (isinstance(parent, ast.keyword) and parent.arg == "strict"):
                yield ast.Constant(not node.value)
        case ast.Constant(value=int()):
            yield ast.Constant(node.value + 1)
        case ast.Constant(value=float()):
            yield ast.Constant(2.0 * node.value or 1.0)
        case ast.Return(value=ast.AST()) if _text(node) not in {"return None", "return False"}:
            yield ast.Return(ast.Constant(None))
        case ast.Expr(value=ast.Call()):
            yield ast.Pass()
        case ast.Break():
            yield ast.Continue()
        case ast.Continue():
            yield ast.Break()
        case ast.keyword() if isinstance(parent, ast.Call) and _text(parent.func) == "replace":
            yield ast.Delete([])
        case ast.Call() if isinstance(parent, ast.Tuple | ast.List) and len(parent.elts) > 3:
            yield ast.Delete([])
    is_plain = isinstance(node, ast.Name | ast.Attribute | ast.Call | ast.NamedExpr)
    if is_plain and field == "test" and isinstance(parent, ast.If | ast.IfExp | ast.While):
        yield ast.UnaryOp(ast.Not(), node)


class _Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds the changed module instead of the file's."""

    def __init__(self, mutant: Mutant) -> None:
        self.mutant = mutant
        self.name = mutant.path.removesuffix(".py").replace("/", ".").removesuffix(".__init__")

    def find_spec(self, fullname: str, *_: Any) -> Any:
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(fullname, ROOT / self.mutant.path, loader=self)

    def create_module(self, spec: Any) -> None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        exec(compile(self.mutant.tree(), str(ROOT / self.mutant.path), "exec"), module.__dict__)


class _Chosen:
    """Keeps the chosen tests, in their order, and writes each that begins, or a file that is not imported."""

    def __init__(self, tests: Sequence[str], writing: int) -> None:
        self.order = {name: k for k, name in enumerate(tests)}
        self.writing = writing

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        chosen = [one for one in items if one.nodeid in self.order]
        items[:] = sorted(chosen, key=lambda one: self.order[one.nodeid])

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        os.write(self.writing, f"{nodeid}\n".encode())

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            os.write(self.writing, f"{report.nodeid} (import)\n".encode())


class _Mapped:
    """Notes which lines each test executes, and its time; leaves out tests beyond so many seconds."""

    def __init__(self, measured: coverage.Coverage, most_s: float) -> None:
        self.measured, self.most_s, self.took_s = measured, most_s, {}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        random.Random(1).shuffle(items)

    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        if sum(self.took_s.values()) > self.most_s:
            pytest.skip("the file's time is over")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Any:
        self.measured.switch_context(item.nodeid)
        before = sum(os.times()[:4])
        try:
            return (yield)
        finally:
            self.took_s[item.nodeid] = sum(os.times()[:4]) - before
            self.measured.switch_context("")


def _pytest(files: Iterable[str], plugin: object) -> int:
    checks = list(hypothesis.HealthCheck)
    hypothesis.settings.register_profile(
        "mutants", deadline=None, derandomize=True, database=None, suppress_health_check=checks
    )
    hypothesis.settings.load_profile("mutants")
    # Assertions are not rewritten: pytest would import the package itself then, past the change.
    options = ["-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no", "--assert=plain"]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
    return int(pytest.main([*options, *files], plugins=[plugin]))


def _forked(work: Callable[[int], int], limit_s: float) -> tuple[int, str]:
    """Return how a function ended in a child: its status (-1 where it hung) and what it wrote."""
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, MOST_WRITTEN)
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        os.close(reading)
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s), int(limit_s) + 1))
        nothing = os.open(os.devnull, os.O_RDWR)
        for each in (0, 1, 2):
            os.dup2(nothing, each)
        status = 70
        try:
            status = work(writing)
        finally:
            os._exit(status)
    os.close(writing)
    until, pid, status = time.monotonic() + WAITS * limit_s, 0, -1
    while time.monotonic() < until and pid == 0:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid == 0:
            time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        # Its group: what the tests have started goes with it.
        os.killpg(child, signal.SIGKILL)
    if pid == 0:
        os.waitpid(child, 0)
    os.set_blocking(reading, False)
    text = b""
    with contextlib.suppress(BlockingIOError):
        text = os.read(reading, MOST_WRITTEN)
    os.close(reading)
    ended = os.waitstatus_to_exitcode(status) if pid else -1
    return (-1 if ended in {-signal.SIGXCPU, -signal.SIGKILL} else ended), text.decode()


Tests = dict[str, dict[str, Any]]
"""Of each file of tests, by name: seconds, and by source the lines that it executes."""


def map_of(package: Package, sources: Sequence[str], most_s: float) -> Tests:
    """Return what each test of a package executes."""
    digest = hashlib.sha256(b"".join((ROOT / one).read_bytes() for one in sources)).hexdigest()[:16]
    digest += "" if most_s >= 1e9 else f" {most_s:g} "
    folders = [ROOT / one for one in package.tests]
    files = [each for one in folders for each in ([one] if one.is_file() else one.rglob("test_*.py"))]
    found = {}
    for file in sorted(str(one.relative_to(ROOT)) for one in files):
        key = hashlib.sha256((digest + file).encode() + (ROOT / file).read_bytes()).hexdigest()[:24]
        kept = Path(tempfile.gettempdir()) / "sattrack-mutants" / f"{key}.json.gz"
        if not kept.exists():
            kept.parent.mkdir(exist_ok=True)
            print(f"mapping {file}", file=sys.stderr, flush=True)
            status, _ = _forked(
                lambda _, file=file, kept=kept: _write_map(file, sources, kept, most_s), 1800.0
            )
            if status != 0:
                raise SystemExit(f"{file} fails without any change: mend it first")
        found[file] = json.loads(gzip.decompress(kept.read_bytes()))
    return found


def _write_map(file: str, sources: Sequence[str], kept: Path, most_s: float) -> int:
    measured = coverage.Coverage(data_file=None, include=[str(ROOT / one) for one in sources])
    mapped = _Mapped(measured, most_s)
    measured.start()
    status = _pytest([file], mapped)
    measured.stop()
    tests: Tests = {name: {"s": took_s, "lines": {}} for name, took_s in mapped.took_s.items()}
    for one in sources:
        for line, names in measured.get_data().contexts_by_lineno(str(ROOT / one)).items():
            for name in filter(None, names):
                tests[name]["lines"].setdefault(one, []).append(line)
    kept.write_bytes(gzip.compress(json.dumps(tests).encode()))
    return 0 if status == pytest.ExitCode.NO_TESTS_COLLECTED else status


def _functions(path: str) -> dict[int, set[int]]:
    """Return of each line inside of a function the lines of its statement."""
    found: dict[int, set[int]] = {}
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            for one in (each for part in node.body for each in ast.walk(part) if isinstance(each, ast.stmt)):
                last = one.body[0].lineno - 1 if hasattr(one, "body") else one.end_lineno or one.lineno
                lines = set(range(one.lineno, max(one.lineno, last) + 1))
                found |= dict.fromkeys(lines, lines)
    return found


def tests_for(mutant: Mutant, mapped: Tests) -> list[tuple[float, str, str]]:
    """Return the tests that execute a mutant's statement, or all of the files that run its module.

    All, where none does: what runs on import alone is in no test, and a table is read without a line run.
    The quickest come first, by OWN_COUNT.
    """
    lines = _functions(mutant.path).get(mutant.line, set())
    found, others = [], []
    for file, tests in mapped.items():
        runs = any(mutant.path in one["lines"] for one in tests.values())
        for name, one in tests.items():
            if not lines.isdisjoint(one["lines"].get(mutant.path, ())):
                found.append((one["s"], name, file))
            elif runs:
                others.append((one["s"], name, file))
    own = f"test_{Path(mutant.path).stem}"
    return sorted(found or others, key=lambda one: one[0] * (OWN_COUNT if Path(one[2]).stem == own else 1.0))


def outcome_of(
    mutant: Mutant, mapped: Tests, budget_s: float, first: Collection[str] = ()
) -> tuple[str, str | None]:
    """Return what became of a mutant (caught, hung, survived, unseen) and the test that showed it.

    Of the tests for it those named `first` come first.
    """
    total_s, chosen = 0.0, []
    for one in sorted(tests_for(mutant, mapped), key=lambda each: each[1] not in first):
        if total_s + one[0] <= budget_s or not chosen:
            total_s += one[0]
            chosen.append(one)
    if not chosen:
        return "unseen", None

    def work(writing: int) -> int:
        sys.meta_path.insert(0, _Changed(mutant))
        plugin = _Chosen([name for _, name, _ in chosen], writing)
        return _pytest(sorted({file for _, _, file in chosen}), plugin)

    status, begun = _forked(work, total_s * TIMES_LONGER + LONGER_S)
    outcome = {0: "survived", -1: "hung"}.get(status, "caught")
    return outcome, None if outcome == "survived" else (begun.splitlines() or ["no test begun"])[-1]


def print_needless(needed: Collection[str], mapped: Tests) -> None:
    """Print the tests that caught no mutant, the slowest first."""
    took_s = {name: one["s"] for tests in mapped.values() for name, one in tests.items()}
    needless = sorted(took_s.keys() - set(needed), key=lambda one: -took_s[one])
    for name in needless:
        print(f"needless {took_s[name]:.2f} s {name}")
    spared_s = sum(took_s[name] for name in needless)
    print(f"{len(needless)} of {len(took_s)} tests, {spared_s:.1f} of {sum(took_s.values()):.1f} s")


def executed(package: Package, sources: Sequence[str]) -> dict[str, set[int]]:
    """Return the lines of each source that a package's tests and their own processes execute."""
    with tempfile.TemporaryDirectory() as folder:
        data, settings = Path(folder) / "data", Path(folder) / "settings"
        include = "".join(f"    {ROOT / one}\n" for one in sources)
        settings.write_text(
            f"[run]\nparallel = true\nsigterm = true\npatch = subprocess, _exit\ndata_file = {data}\n"
            f"include =\n{include}"
        )
        program = [sys.executable, "-m", "coverage", "run", f"--rcfile={settings}", "-m", "pytest", "-q"]
        options = ["-n", "2", "--dist", "worksteal", "-p", "no:cacheprovider", "--no-header", "--tb=short"]
        ended = subprocess.run([*program, *options, *package.tests], cwd=ROOT, check=False)
        if ended.returncode != 0:
            raise SystemExit("tests fail without any change: mend them first")
        measured = coverage.Coverage(config_file=str(settings))
        measured.combine()
        found = measured.get_data()
        return {one: set(found.lines(str(ROOT / one)) or ()) for one in sources}


def print_lines(name: str, run: Mapping[str, set[int]]) -> None:
    """Print which share of a package's statements its tests execute, and the lines that none does."""
    every = seen = 0
    for path in run:
        statements = set(coverage.Coverage(data_file=None).analysis2(str(ROOT / path))[1])
        missing = sorted((statements & set(_functions(path))) - run[path])
        every, seen = every + len(statements), seen + len(statements) - len(missing)
        if missing:
            print(f"{path}: {', '.join(map(str, missing))}")
    print(f"{name}: {seen} of {every} statements, {seen / every:.1%}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("package", choices=[*PACKAGES])
    parser.add_argument("--module", help="only changes of this one of the package's modules")
    parser.add_argument("--sample", type=int, default=100, help="mutants, chosen at random; 0: all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--budget", type=float, default=25.0, help="seconds of tests for one mutant")
    parser.add_argument(
        "--file-s", type=float, default=1e9, help="seconds of tests of one file, drawn at random"
    )
    parser.add_argument(
        "--again", type=Path, help="only the survivors that a run before has printed to this file"
    )
    parser.add_argument("--lines", action="store_true", help="which statements the tests execute; no mutants")
    parser.add_argument("--needed", action="store_true", help="name the tests that no mutant needs")
    options = parser.parse_args()
    os.chdir(ROOT)
    sys.path[:0] = [str(ROOT), str(ROOT / "bench")]
    for one in LIBRARIES:
        importlib.import_module(one)
    package = PACKAGES[options.package]
    sources = sorted(str(each.relative_to(ROOT)) for one in package.sources for each in ROOT.glob(one))
    if options.lines:
        print_lines(options.package, executed(package, sources))
        return 0
    among = [path for path in sources if options.module in {None, Path(path).stem}]
    mutants = [one for path in among for one in mutants_of(path)]
    every = len(mutants)
    if options.again is not None:
        printed = {line.partition(" ")[2] for line in options.again.read_text().splitlines()}
        mutants = [one for one in mutants if one.where in printed]
    elif options.sample:
        mutants = random.Random(options.seed).sample(mutants, min(options.sample, every))
    mapped = map_of(package, sources, options.file_s)
    count, begun = Counter(), time.monotonic()
    needed: set[str] = set()
    for one in mutants:
        outcome, test = outcome_of(one, mapped, options.budget, first=needed if options.needed else ())
        count[outcome] += 1
        needed |= {test} if test else set()
        print(f"{outcome} {one.where}{f' | {test}' if test else ''}", flush=True)
    caught = count["caught"] + count["hung"]
    print(
        f"{options.package}: {len(mutants)} of {every} mutants (seed {options.seed}), {caught} caught, "
        f"{caught / max(1, len(mutants)):.1%}; {(time.monotonic() - begun) / 60.0:.0f} min"
    )
    if options.needed:
        print_needless(needed, mapped)
    return 0


if __name__ == "__main__":
    sys.exit(main())

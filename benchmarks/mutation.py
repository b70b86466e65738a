"""Mutation score of the rooms whose answers decide a verdict: how many small faults do their tests notice?

    python -m pip install coverage
    python benchmarks/mutation.py --sample 400 --seed 1 --coverage map.json | tee first.txt
    python benchmarks/mutation.py --again first.txt
    python benchmarks/mutation.py --rooms truth --sample 60 --only gse/truth/alignment.py

A random sample of mutants, shared among the rooms by their number of faults (30 at least each), in a copy of the tree
in a temporary folder. First the tests of the rooms run once, and coverage notes which of them run which line. Then each
mutant meets those that run its line, first those that import its module, the quickest of them first, until one fails or
they took ``--most`` seconds: the score is a bound from below. The golden replays are left out: ``gse ci --update``
would bless a wrong report. The rooms are mixed, so a run that is stopped has told of each of them.

A mutant is put in the place of the module in a process that has all of gse in memory already. Where that cannot work
(machine code, which is compiled anew for a mutated module and for those that import it) a process of its own reads the
mutated tree; so it does, at the end, with those that survived.

Mutations: comparison (boundary and negation), arithmetic, number (an integer plus and minus 1, a float doubled and
halved), Boolean constant, ``and`` and ``or``, condition negated, ``min`` and ``max``, ``any`` and ``all``, minus sign
dropped, value returned replaced by ``None``, loop body never run. Not mutated: annotations, docstrings, decorators,
texts, ``strict=`` of zip, memory layout (``order=``) and cache sizes (``maxsize=``).
"""

import argparse
import ast
import contextlib
import functools
import importlib.util
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import types
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True, slots=True)
class Room:
    """Modules to mutate (with ``:name`` of a function or constant, only that part), and where their tests are."""

    modules: tuple[str, ...]
    tests: tuple[str, ...]


JUDGEMENT = tuple(f"tests/gse/{room}" for room in ("verdict", "diagnosis", "statistics"))
"""One verdict: the tests of each of these rooms see what the others do."""

ROOMS = {
    "verdict": Room(("gse/verdict/*.py",), (*JUDGEMENT, "tests/gse/report")),
    "diagnosis": Room(("gse/diagnosis/*.py",), JUDGEMENT),
    "statistics": Room(("gse/statistics/*.py",), (*JUDGEMENT, "tests/gse/report")),
    "station": Room(("gse/station/*.py",), ("tests/gse/station", "tests/gse/sessions", *JUDGEMENT)),
    "truth": Room(("gse/truth/*.py",), ("tests/gse/truth",)),
    "imaging": Room(("gse/imaging/*.py",), ("tests/gse/imaging",)),
    "identifier": Room(
        (
            "gse/identifier/checks.py",
            "gse/identifier/evidence.py:CHANCE_OF_EVIDENCE",
            "gse/identifier/evidence.py:LOG_ACCEPTED",
            "gse/identifier/evidence.py:LOG_UNAMBIGUOUS",
            "gse/identifier/evidence.py:LOG_STRONG",
            "gse/identifier/hypotheses.py:_LOG_MIRRORED",
            "gse/identifier/hypotheses.py:search_many",
            "gse/identifier/robust.py:_believed",
            "gse/identifier/robust.py:_false_match_probability",
        ),
        ("tests/gse/identifier",),
    ),
}
WITHOUT = ("tests/gse/sessions/test_golden_replays.py",)
COPIED = ("gse", "drivers", "protocols", "tests", "replays", "docs", "benchmarks", "pyproject.toml", "README.md")
KEYWORDS_LEFT_ALONE = {"strict", "order", "maxsize"}
LIBRARIES = (
    "pytest",
    "hypothesis",
    "numba",
    "scipy.spatial.transform",
    "scipy.special",
    "erfa",
    "pydantic",
    "astropy.units",
)
"""In memory before the first test: none of them is mutated."""

MOST_CPU_S = 200
"""A mutant whose tests need more processor time hangs."""

LEAST = 30
"""Mutants of a small room: fewer tell nothing about it."""

_LIGHT_S = 1.5
FIRST_S = 3.0
"""The quickest tests of a mutant, of so long in all, run before the others."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One mutation: of the node ``number`` of a module (or of ``parts`` of it) the change ``change``; and its place."""

    module: str
    parts: tuple[str, ...]
    number: int
    change: int
    place: str


@dataclass(frozen=True, slots=True)
class Mutant:
    """The whole mutated source of a module, and what was changed where."""

    module: str
    line: int
    column: int
    change: str
    source: str
    ran: range | None
    """Lines that a test of it runs; none for what runs when the module is imported."""

    def __str__(self) -> str:
        return f"{self.module}:{self.line}:{self.column}  {self.change}"


COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
TWINS = {"min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum"}


def mutations(node: ast.AST) -> Iterator[Callable[[ast.AST], None]]:
    """What can be done to one node, as functions that change a copy of it."""
    if isinstance(node, ast.Compare):
        for place, operator in enumerate(node.ops):
            for other in COMPARISONS[type(operator)]:
                yield lambda n, place=place, other=other: n.ops.__setitem__(place, other())
    elif isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in ARITHMETIC and not _union_of_types(node):
        yield lambda n: setattr(n, "op", ARITHMETIC[type(n.op)]())
    elif isinstance(node, ast.BoolOp):
        yield lambda n: setattr(n, "op", ast.And() if isinstance(n.op, ast.Or) else ast.Or())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        yield _dropped
    elif isinstance(node, ast.Constant):
        yield from _constants(node.value)
    elif isinstance(node, ast.If | ast.While | ast.IfExp) and ast.unparse(node.test) != "TYPE_CHECKING":
        yield lambda n: setattr(n, "test", ast.UnaryOp(ast.Not(), n.test))
    elif isinstance(node, ast.Return) and not _is_none(node.value):
        yield lambda n: setattr(n, "value", ast.Constant(None))
    elif isinstance(node, ast.For):
        yield lambda n: n.body.insert(0, ast.Break())
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in TWINS:
        yield lambda n: setattr(n, "id", TWINS[n.id])
    elif isinstance(node, ast.Attribute) and node.attr in TWINS:
        yield lambda n: setattr(n, "attr", TWINS[n.attr])


def _is_none(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and value.value is None)


def _union_of_types(node: ast.AST) -> bool:
    """``First | Second`` of two classes."""
    right = getattr(node, "right", None)
    return isinstance(getattr(node, "op", None), ast.BitOr) and isinstance(right, ast.Name) and right.id[:1].isupper()


def _constants(value: object) -> Iterator[Callable[[ast.AST], None]]:
    if isinstance(value, bool):
        new: tuple[object, ...] = (not value,)
    elif isinstance(value, int):
        new = (value + 1, value - 1)
    elif isinstance(value, float):
        new = (value * 2, value / 2) if value else (1.0,)
    else:
        new = ()
    for other in new:
        yield lambda n, other=other: setattr(n, "value", other)


def _dropped(node: ast.AST) -> None:
    """A minus sign or an inversion becomes a plus sign, ``not`` becomes ``not not``."""
    assert isinstance(node, ast.UnaryOp)
    if isinstance(node.op, ast.Not):
        node.operand = ast.UnaryOp(ast.Not(), node.operand)
    else:
        node.op = ast.UAdd()


def nodes(tree: ast.AST, parts: set[str]) -> Iterator[ast.AST]:
    """The nodes that may be mutated, in the order of the source; those of ``parts`` only where any are named."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(tree, ast.Module) and parts and not parts & _names(child):
            continue
        if _left_alone(tree, child):
            continue
        yield child
        yield from nodes(child, set())


def _names(statement: ast.AST) -> set[str]:
    if isinstance(statement, ast.Assign):
        return {node.id for target in statement.targets for node in ast.walk(target) if isinstance(node, ast.Name)}
    return {getattr(statement, "name", "")}


def _left_alone(parent: ast.AST, child: ast.AST) -> bool:
    if isinstance(parent, ast.FunctionDef | ast.ClassDef) and child in parent.decorator_list:
        return True
    if isinstance(parent, ast.FunctionDef) and child is parent.returns:
        return True
    if isinstance(parent, ast.arg | ast.AnnAssign) and child is parent.annotation:
        return True
    if isinstance(parent, ast.FormattedValue) and child is parent.format_spec:
        return True
    if isinstance(parent, ast.Module) and isinstance(child, ast.Assign) and isinstance(child.value, ast.Subscript):
        return True  # A name for a type.
    return isinstance(child, ast.keyword) and child.arg in KEYWORDS_LEFT_ALONE


def faults(room: Room, only: str) -> list[Fault]:
    """Every fault of a room that the operators know, in the order of its source."""
    parts: dict[str, set[str]] = {}
    for entry in room.modules:
        pattern, _, part = entry.partition(":")
        for path in sorted(ROOT.glob(pattern)):
            parts.setdefault(str(path.relative_to(ROOT)), set()).update({part} if part else ())
    return [
        Fault(module, tuple(sorted(named)), number, change, _place(module, node))
        for module, named in parts.items()
        if only in module
        for number, node in enumerate(nodes(ast.parse((ROOT / module).read_text()), named))
        for change in range(len(list(mutations(node))))
    ]


def _place(module: str, node: ast.AST) -> str:
    return f"{module}:{getattr(node, 'lineno', 0)}:{getattr(node, 'col_offset', 0)}"


def mutant_of(fault: Fault) -> Mutant:
    """The mutated source of a fault."""
    tree = ast.parse((ROOT / fault.module).read_text())
    node = next(node for place, node in enumerate(nodes(tree, set(fault.parts))) if place == fault.number)
    before = _shown(node)
    list(mutations(node))[fault.change](node)
    after, line, column = _shown(node), getattr(node, "lineno", 0), getattr(node, "col_offset", 0)
    source = ast.unparse(ast.fix_missing_locations(tree))
    return Mutant(fault.module, line, column, f"{before}  ->  {after}", source, _lines_run(fault.module, line))


def _lines_run(module: str, line: int) -> range | None:
    """The lines of the innermost statement of a function that a line belongs to, without the statements in it."""
    inside = [
        statement
        for function in ast.walk(ast.parse((ROOT / module).read_text()))
        if isinstance(function, ast.FunctionDef)
        for part in function.body
        for statement in ast.walk(part)
        if isinstance(statement, ast.stmt) and statement.lineno <= line <= (statement.end_lineno or 0)
    ]
    if not inside:
        return None
    innermost = max(inside, key=lambda one: (one.lineno, -(one.end_lineno or 0)))
    body = getattr(innermost, "body", None)
    return range(innermost.lineno, body[0].lineno if body else (innermost.end_lineno or 0) + 1)


def _shown(node: ast.AST) -> str:
    """The first line of a node's source, or of a loop its first two."""
    return "; ".join(line.strip() for line in ast.unparse(node).splitlines()[:2])[:90]


def importers(tree: Path, module: str) -> list[set[str]]:
    """The module, those that import it, those that import these, ...: their machine code may contain its own."""
    texts = {str(path.relative_to(tree)): path.read_text() for path in (tree / "gse").rglob("*.py")}
    steps = [{module}]
    while steps[-1]:
        names = [_import_of(name) for name in steps[-1]]
        new = {path for path, text in texts.items() if any(name in text for name in names)}
        steps.append(new.difference(*steps))
    return steps


@functools.cache
def _text(path: str) -> str:
    return (ROOT / path).read_text()


def _import_of(module: str) -> str:
    return f"from {module[:-3].replace('/', '.')} import"


@dataclass(frozen=True, slots=True)
class Coverage:
    """Which tests run which line of which module, and how long each takes."""

    lines: dict[str, dict[int, list[str]]]
    seconds: dict[str, float]

    def tests_of(self, mutant: Mutant, most_s: float) -> list[list[str]]:
        """The tests that may notice a mutant, in two parts, of ``most_s`` in all.

        First come those of files that import its module, then the quickest. Of such files all tests run, if they are
        light: where a function keeps what it returned, coverage sees its lines in one test only.
        """
        lines = self.lines.get(mutant.module, {})
        names = {name for line in mutant.ran or lines for name in lines.get(line, ())}
        if not names and "@compiled" in mutant.source:  # Machine code is run unseen.
            steps = ({name for path in step for tests in self.lines.get(path, {}).values() for name in tests}
                     for step in importers(ROOT, mutant.module))  # fmt: skip
            names = next((step for step in steps if step), set())
        heaviest = self._heaviest_s()
        direct = {name for name in self.seconds if _import_of(mutant.module) in _text(_file(name))}
        names |= {name for name in direct if heaviest[_file(name)] < _LIGHT_S}
        parts: tuple[list[str], list[str]] = [], []
        spent_s = 0.0
        cost = {name: (name not in direct, heaviest[_file(name)], self.seconds[name], name) for name in names}
        for name in sorted(names, key=cost.__getitem__):
            spent_s += self.seconds[name]
            if spent_s > most_s and parts[0]:
                break
            parts[spent_s > FIRST_S].append(name)
        return [part for part in parts if part]

    def _heaviest_s(self) -> dict[str, float]:
        """Of each file the longest test: what is made for all of its tests counts in the first of them."""
        found: dict[str, float] = {}
        for name, seconds in self.seconds.items():
            found[_file(name)] = max(found.get(_file(name), 0.0), seconds)
        return found


def _file(name: str) -> str:
    return name.split("::")[0]


def coverage_of(tree: Path, folders: list[str], kept: Path | None) -> Coverage:
    """Run the tests of folders once, in a process of its own, unless what they gave was ``kept``."""
    found_in = kept or tree / "map.json"
    if not found_in.exists():
        subprocess.run([sys.executable, __file__, "--map", str(tree), *folders], check=True, stdout=sys.stderr)
        if kept:
            shutil.copy(tree / "map.json", kept)
    found = json.loads(found_in.read_text())
    lines = {name: {int(line): tests for line, tests in by.items()} for name, by in found["lines"].items()}
    return Coverage(lines, found["seconds"])


class Watch:
    """A pytest plugin: which lines each test runs with what is made for it, how long it takes, whether one fails."""

    def __init__(self) -> None:
        self.coverage = importlib.import_module("coverage").Coverage(data_file=None, source=["gse"])
        self.seconds: dict[str, float] = {}
        self.failed: list[str] = []

    def pytest_runtest_setup(self, item: Any) -> None:
        """What a test makes may be for all tests of its file."""
        self.coverage.start()
        self.coverage.switch_context(f"{item.nodeid}|setup")

    def pytest_runtest_call(self, item: Any) -> None:
        """The test itself."""
        self.coverage.switch_context(f"{item.nodeid}|run")

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Add the time of one phase of a test."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        self.failed += [report.nodeid] * report.failed


def write_map(tree: Path, folders: list[str]) -> None:
    """Run tests under coverage, and write which of them run which line to ``map.json``."""
    os.chdir(tree)
    sys.path[0] = str(tree)
    watch = Watch()
    options = ["-n", "0", "-q", "--hypothesis-profile", "ci"]
    without = [f"--deselect={name}" for name in WITHOUT]
    code = pytest.main([*options, *without, *folders], plugins=[watch])
    if code not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        sys.exit(f"the tests could not run (pytest ended with {code}): no mutant would meet one; see above")
    for name in watch.failed:
        print(f"left out, since it fails without any mutant: {name}", file=sys.stderr)
        watch.seconds.pop(name, None)
    of_file: dict[str, list[str]] = {}
    for name in watch.seconds:
        of_file.setdefault(_file(name), []).append(name)
    watch.coverage.stop()
    data = watch.coverage.get_data()
    lines: dict[str, dict[int, list[str]]] = {}
    for path in data.measured_files():
        by_line = data.contexts_by_lineno(path)
        lines[str(Path(path).relative_to(tree))] = {
            line: sorted(
                {name for context in contexts if context for name in _tests(context, of_file)} & set(watch.seconds)
            )
            for line, contexts in by_line.items()
        }
    (tree / "map.json").write_text(json.dumps({"lines": lines, "seconds": watch.seconds}))


def _tests(context: str, of_file: dict[str, list[str]]) -> list[str]:
    """The tests of a context of coverage; what is made for one test may be for all of its file."""
    name, _, phase = context.rpartition("|")
    return [name] if phase == "run" else of_file[_file(name)]


def copy_of_tree(folder: Path) -> Path:
    """A copy of what the tests need, machine code included, with the times of its files."""
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, symlinks=True)
        elif source.exists():
            shutil.copy2(source, folder / name)
    return folder


class Tester:
    """A process that forks for each run of the tests; it has the libraries in memory, or with ``whole`` all of gse."""

    def __init__(self, tree: Path, *, whole: bool = False) -> None:
        self.tree = tree
        self._whole = ["--whole"] if whole else []
        self._process: subprocess.Popen[str] | None = None

    def _started(self) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, __file__, "--serve", str(self.tree), *self._whole],
            env=os.environ
            | {"PYTHONPATH": str(self.tree), "PYTHONHASHSEED": "0", "NUMBA_CACHE_DIR": str(_rooms(self.tree))},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def outcome(self, names: list[str], most_cpu_s: int, mutant: Mutant | None = None) -> tuple[str, float]:
        """What the tests say of the tree: ``survived``, ``killed`` or ``timeout``, and their processor time in s.

        A ``mutant`` takes the place of its module in memory.
        """
        self._process = self._process or self._started()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        replaced = (mutant.module, mutant.source) if mutant else None
        print(json.dumps([names, most_cpu_s, replaced]), file=self._process.stdin, flush=True)
        word, cpu_s = json.loads(self._process.stdout.readline())
        return word, cpu_s

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.communicate()


def serve(tree: Path, *, whole: bool) -> None:
    """Read names of tests, a limit of processor time and a mutant, line by line, and write what the tests say."""
    os.chdir(tree)
    sys.path[0] = str(tree)
    for name in LIBRARIES:
        importlib.import_module(name)
    iers = importlib.import_module("astropy.utils.iers")
    iers.IERS_Auto.read = functools.cache(iers.IERS_Auto.read)  # Each run of the tests reads it anew: 1.5 s.
    iers.IERS_Auto.read()
    if whole:
        sys.path.append(str(tree / "tests"))
        for path in (*sorted((tree / "gse").rglob("*.py")), *sorted((tree / "tests" / "skies").glob("*.py"))):
            if path.stem not in ("__main__", "__init__"):
                base = tree / "tests" if "skies" in path.parts else tree
                with contextlib.suppress(ModuleNotFoundError):  # of a solver that is not installed
                    importlib.import_module(".".join(path.relative_to(base).with_suffix("").parts))
    for line in sys.stdin:
        print(json.dumps(_forked(*json.loads(line))), flush=True)


class Only:
    """A pytest plugin: some tests by their names, or those of a file by its name, in that order."""

    def __init__(self, names: list[str]) -> None:
        self._turns = {name: turn for turn, name in enumerate(names)}

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Keep these."""
        named = ((self._turn(item.nodeid), item) for item in items)
        items[:] = [item for turn, item in sorted(named, key=lambda pair: pair[0]) if turn < len(self._turns)]

    def _turn(self, name: str) -> int:
        of_file = self._turns.get(_file(name), len(self._turns))
        return self._turns.get(name, of_file)


def _forked(names: list[str], most_cpu_s: int, replaced: tuple[str, str] | None) -> tuple[str, float]:
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (most_cpu_s, most_cpu_s))
        nowhere = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(nowhere, stream)
        options = ["-x", "-q", "-n", "0", "--assert=plain", "-p", "no:cacheprovider", "--hypothesis-profile", "ci"]
        try:
            if replaced:
                replace_in_memory(*replaced)
        except (KeyError, ValueError):
            os._exit(0)  # No function or constant: the tree will tell.
        of_files = dict.fromkeys(_file(name) for name in names)
        os._exit(int(pytest.main([*options, *of_files], plugins=[Only(names)])))
    _, status, usage = os.wait4(child, 0)
    unheard = status == 0 or (os.WIFEXITED(status) and os.WEXITSTATUS(status) == pytest.ExitCode.NO_TESTS_COLLECTED)
    word = "survived" if unheard else "timeout" if os.WIFSIGNALED(status) else "killed"
    return word, usage.ru_utime + usage.ru_stime


def replace_in_memory(module: str, source: str) -> None:
    """Let the one statement of a loaded module that a mutated source has otherwise take effect.

    Functions and methods keep their identity and take the new code; a constant is replaced wherever it was imported.
    """
    old = importlib.import_module(module[:-3].replace("/", "."))
    pairs = zip(ast.parse(Path(str(old.__file__)).read_text()).body, ast.parse(source).body, strict=True)
    (changed,) = (new for sound, new in pairs if ast.dump(sound) != ast.dump(new))
    names = dict(vars(old))
    exec(compile(ast.Module([changed], []), str(old.__file__), "exec", dont_inherit=True), names)  # noqa: S102
    for name in _names(changed):
        before, value = vars(old)[name], names[name]
        if isinstance(before, type):
            for key, part in vars(before).items():
                _take_code(part, vars(value).get(key))
        elif not _take_code(before, value):
            for other in list(sys.modules.values()):
                if getattr(other, "__dict__", {}).get(name) is before:
                    setattr(other, name, value)


def _take_code(old: object, new: object) -> bool:
    """Whether these are functions; the old one then does what the new one does."""
    if isinstance(old, property) and isinstance(new, property):
        return _take_code(old.fget, new.fget)
    if hasattr(old, "cache_clear"):
        old.cache_clear()
    old, new = (getattr(one, "__wrapped__", getattr(one, "__func__", one)) for one in (old, new))
    if not isinstance(old, types.FunctionType) or not isinstance(new, types.FunctionType):
        return False
    if len(old.__code__.co_freevars) == len(new.__code__.co_freevars):
        old.__code__, old.__defaults__, old.__kwdefaults__ = new.__code__, new.__defaults__, new.__kwdefaults__
    return True


def with_mutant(testers: tuple[Tester, Tester], mutant: Mutant, parts: list[list[str]]) -> str:
    """The outcome of one mutant under tests, part by part: in memory, or in a tree where that cannot work."""
    slow, fast = testers
    if "@compiled" in mutant.source:
        return in_tree(slow, mutant, parts, MOST_CPU_S)
    said = (fast.outcome(tests, MOST_CPU_S, mutant)[0] for tests in parts)
    return next((word for word in said if word != "survived"), "survived")


def in_tree(tester: Tester, mutant: Mutant, parts: list[list[str]], most_cpu_s: int) -> str:
    """The outcome of one mutant in the tree, which is the same again afterwards."""
    tree = tester.tree
    path, sound = tree / mutant.module, tree / "sound.py"
    modules = set().union(*importers(tree, mutant.module))
    machine_code = {code: code.read_bytes() for code in _machine_code(tree, modules)}
    for code in machine_code:
        code.unlink()
    path.rename(sound)
    path.write_text(mutant.source)
    try:
        said = (tester.outcome(names, most_cpu_s)[0] for names in parts)
        return next((word for word in said if word != "survived"), "survived")
    finally:
        sound.replace(path)
        Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)
        for code in _machine_code(tree, modules):
            code.unlink()
        for code, content in machine_code.items():
            code.write_bytes(content)


def _machine_code(tree: Path, modules: set[str]) -> list[Path]:
    """The files of numba's cache that belong to modules."""
    paths = [Path(module) for module in modules]
    return [code for path in paths for code in _rooms(tree).glob(f"{path.parent.name}_*/{path.stem}.*.nb?")]


def _rooms(tree: Path) -> Path:
    """Where numba keeps what it compiled of a tree."""
    return tree / "build" / "machine-code"


def outcomes(
    mutants: list[Mutant], testers: SimpleQueue[tuple[Tester, Tester]], coverage: Coverage, most_s: float
) -> dict[Mutant, str]:
    """Run mutants, each with its line of output; at the end once more, in a tree, those that survived in memory."""

    def one(mutant: Mutant, run: Callable[..., str]) -> str:
        both = testers.get()
        try:
            said = run(both, mutant, coverage.tests_of(mutant, most_s))
        finally:
            testers.put(both)
        print(f"{said:9} {mutant}", flush=True)
        return said

    def once_more(both: tuple[Tester, Tester], mutant: Mutant, parts: list[list[str]]) -> str:
        return in_tree(both[0], mutant, parts, MOST_CPU_S)

    with ThreadPoolExecutor(testers.qsize()) as pool:
        said = dict(zip(mutants, pool.map(lambda mutant: one(mutant, with_mutant), mutants), strict=True))
        again = [mutant for mutant, word in said.items() if word == "survived" and "@compiled" not in mutant.source]
        print(f"once more, in a tree: {len(again)}", flush=True)
        said |= zip(again, pool.map(lambda mutant: one(mutant, once_more), again), strict=True)
    return said


def print_table(said: dict[str, list[str]]) -> None:
    """The score of each room and of all together."""
    print(f"{'room':12} {'of':>5} {'killed':>7} {'timeout':>8} {'survived':>9} {'score':>7}")
    for name, words in [*said.items(), ("all", [word for room in said.values() for word in room])]:
        killed, hung, left = (words.count(word) for word in ("killed", "timeout", "survived"))
        share = 100 * (1 - left / max(len(words), 1))
        print(f"{name:12} {len(words):5} {killed:7} {hung:8} {left:9} {share:7.1f} %")


def sampled(names: list[str], options: argparse.Namespace) -> dict[str, list[Mutant]]:
    """The mutants of each room that the seed chooses, in its order."""
    every = {name: faults(ROOMS[name], options.only) for name in names}
    per_fault = options.sample / max(sum(map(len, every.values())), 1)
    return {
        name: [
            mutant_of(fault)
            for fault in random.Random(f"{name} {options.seed}").sample(
                found, min(max(LEAST, round(per_fault * len(found))), len(found))
            )
        ]
        for name, found in every.items()
    }


def named(names: list[str], options: argparse.Namespace) -> dict[str, list[Mutant]]:
    """The mutants of each room that survived in an earlier output, whatever it was a sample of."""
    texts = survivors_of(options.again)
    places = {text.split("  ")[0] for text in texts}
    made = {
        name: [mutant_of(fault) for fault in faults(ROOMS[name], options.only) if fault.place in places]
        for name in names
    }
    return {name: [one for one in some if str(one) in texts] for name, some in made.items()}


def survivors_of(output: Path) -> set[str]:
    """The lines of an earlier output that name a survivor, without the first word."""
    lines = [line.split(maxsplit=1) for line in output.read_text().splitlines() if line.strip()]
    last = {text[0]: word for word, *text in lines if text}
    return {text for text, word in last.items() if word == "survived"}


def main() -> None:
    """Sample, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rooms", default=",".join(ROOMS), help="of: " + ", ".join(ROOMS))
    parser.add_argument("--sample", type=int, default=400, help="mutants in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="only modules whose path contains this")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--most", type=float, default=40.0, help="seconds of tests for one mutant")
    parser.add_argument("--coverage", type=Path, help="file for what coverage notes, to use it again on the same tree")
    parser.add_argument("--again", type=Path, help="an earlier output of the same tree: only its survivors")
    parser.add_argument("--map", nargs="+", help=argparse.SUPPRESS)
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--whole", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve(options.serve, whole=options.whole)
        return
    if options.map:
        write_map(Path(options.map[0]), options.map[1:])
        return
    if unknown := set(options.rooms.split(",")) - set(ROOMS):
        parser.error(f"no room is called {sorted(unknown)[0]}; known are: {', '.join(ROOMS)}")
    with tempfile.TemporaryDirectory(prefix="gse-mutation-") as folder:
        trees = [copy_of_tree(Path(folder) / str(number)) for number in range(options.workers)]
        made = [(Tester(tree), Tester(tree, whole=True)) for tree in trees]
        testers: SimpleQueue[tuple[Tester, Tester]] = SimpleQueue()
        for both in made:
            testers.put(both)
        chosen = options.rooms.split(",")
        folders = sorted({folder for name in chosen for folder in ROOMS[name].tests})
        coverage = coverage_of(trees[0], folders, options.coverage)
        rooms = named(chosen, options) if options.again else sampled(chosen, options)
        mixed = list(dict.fromkeys(one for room in rooms.values() for one in room))
        random.Random(options.seed).shuffle(mixed)
        print(f"seed {options.seed}, {len(mixed)} mutants, without the golden replays", flush=True)
        said = outcomes(mixed, testers, coverage, options.most)
        print_table({name: [said[one] for one in room] for name, room in rooms.items()})
        for tester in (one for both in made for one in both):
            tester.close()


if __name__ == "__main__":
    main()

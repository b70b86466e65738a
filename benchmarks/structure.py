"""The structure of the source: files, rooms, floors, lines, names that mean several things, and the walks.

python benchmarks/structure.py [REV]    a table, before (git revision REV, default ff1ed200) and after (this tree)
python benchmarks/structure.py --rooms  the rooms of this tree, floor by floor, with what each imports
python benchmarks/structure.py --walks  what a reader passes from a chunk to its result, in a verdict, in a session of a
                                        campaign: files and functions of this tree that run, traced on golden replays

A room is a package below gse, or a module that lies flat in it; drivers and protocols are one room each. An arrow is
one room that imports another. A room stands one floor above the highest room that it imports. Lines are counted as
`wc -l` does.
"""

import ast
import io
import subprocess
import sys
import tarfile
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("gse", "drivers", "protocols")
BEFORE = "ff1ed200"

NAMES_OF_OTHERS = {"Serial"}
"""pyserial looks for a class of this name in each module of a URL handler."""

PUBLIC_OF_OTHERS = {"_replace", "_asdict", "_fields", "_exit"}
"""Of named tuples, and of os: no private names although they begin like one."""

WALKED = ("clear", "faults", "own-answers")
"""Golden replays that are traced: all well, damaged bytes, and a sensor with answers of its own."""

Sources = Mapping[str, str]
"""Text of each Python file, by its path from the root."""


@dataclass(frozen=True, slots=True)
class Longest:
    """A name and how many lines it has."""

    name: str
    lines: int

    def __str__(self) -> str:
        return f"{self.lines} lines, {self.name}"


@dataclass(frozen=True, slots=True)
class SuiteCounts:
    """What binds tests to the inside of the product."""

    functions: int
    private_imports: int
    touch_private: int
    both_sides: int


@dataclass(frozen=True, slots=True)
class Structure:
    """What is counted of one revision."""

    rooms: int
    floors: int
    arrows: int
    circles: int
    modules: int
    packages: int
    flat_modules: int
    ambiguous_classes: int
    median_function: int
    longest_function: Longest
    longest_module: Longest
    code_lines: int
    test_lines: int
    tests: "SuiteCounts"

    def rows(self) -> list[tuple[str, str]]:
        """What is counted, in words, and how many."""
        return [
            ("rooms", str(self.rooms)),
            ("floors", str(self.floors)),
            ("import arrows", str(self.arrows)),
            ("import circles", str(self.circles)),
            ("files of gse, drivers, protocols", str(self.modules)),
            ("packages in gse", str(self.packages)),
            ("flat modules in gse", str(self.flat_modules)),
            ("class names that mean several things", str(self.ambiguous_classes)),
            ("median function", f"{self.median_function} lines"),
            ("longest function", str(self.longest_function)),
            ("longest module", str(self.longest_module)),
            ("lines of code", str(self.code_lines)),
            ("lines of tests", str(self.test_lines)),
            ("tests / code", f"{self.test_lines / self.code_lines:.2f}"),
            ("test functions", str(self.tests.functions)),
            ("private names that tests import", str(self.tests.private_imports)),
            ("tests that touch a private name", str(self.tests.touch_private)),
            ("tests with literals on both sides of a threshold", str(self.tests.both_sides)),
        ]


def tree() -> Sources:
    """The files as they lie here."""
    files = (path for folder in (*PACKAGES, "tests") for path in (ROOT / folder).rglob("*.py"))
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in files}


def revision(name: str) -> Sources:
    """The files of a git revision."""
    packed = subprocess.run(["git", "archive", name], cwd=ROOT, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        members = [member for member in archive.getmembers() if member.isfile() and member.name.endswith(".py")]
        return {
            member.name: content.read().decode()
            for member in members
            if member.name.startswith(tuple(f"{folder}/" for folder in (*PACKAGES, "tests")))
            and (content := archive.extractfile(member))
        }


def structure_of(sources: Sources) -> Structure:
    """Count one revision."""
    modules = _modules(sources)
    imports = room_imports(modules)
    floor_of = floors(imports)
    functions = sorted(_functions(modules), key=lambda function: function.lines)
    lengths = {name: text.count("\n") for name, text in modules.items()}
    longest = max(lengths, key=lambda name: lengths[name])
    return Structure(
        rooms=len(imports),
        floors=1 + max(floor_of.values()),
        arrows=sum(len(below) for below in imports.values()),
        circles=sum(room in _reachable(imports, room) for room in imports),
        modules=len(modules),
        packages=sum(
            path.count("/") == 2 and path.startswith("gse/") for path in sources if path.endswith("/__init__.py")
        ),
        flat_modules=sum(path.count("/") == 1 and path.startswith("gse/") for path in sources),
        ambiguous_classes=sum(count > 1 for name, count in _classes(modules).items() if name not in NAMES_OF_OTHERS),
        median_function=functions[len(functions) // 2].lines,
        longest_function=functions[-1],
        longest_module=Longest(longest, lengths[longest]),
        code_lines=sum(lengths.values()),
        test_lines=sum(text.count("\n") for path, text in sources.items() if path.startswith("tests/")),
        tests=test_counts(sources),
    )


def test_counts(sources: Sources) -> SuiteCounts:
    """Count over all test files; what a test's own helpers touch is not counted for it."""
    thresholds = {name: _thresholds(text) for name, text in _modules(sources).items()}
    functions = imported = touching = both_sides = 0
    for path, text in sources.items():
        if not path.startswith("tests/"):
            continue
        tree = ast.parse(text)
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and _is_ours(node)]
        private = {alias.asname or alias.name for node in imports for alias in node.names if alias.name[0] == "_"}
        near = [value for node in imports for value in thresholds.get(str(node.module), ())]
        own = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)} | _set_on_self(tree)
        tests = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")]
        functions += len(tests)
        imported += len(private)
        touching += sum(_touches(test, private, own) for test in tests)
        both_sides += sum(_straddles(test, near) for test in tests)
    return SuiteCounts(functions, imported, touching, both_sides)


def _is_ours(node: ast.ImportFrom) -> bool:
    return (node.module or "").partition(".")[0] in PACKAGES


def _thresholds(text: str) -> list[float]:
    """The numbers that module constants are, without 0, 1 and 2, which stand everywhere."""
    values = (node.value for node in ast.parse(text).body if isinstance(node, ast.Assign))
    return [number for value in values for number in _number(value) if number not in (0, 1, 2)]


def _number(node: ast.expr) -> Iterator[float]:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        yield float(node.value)


def _set_on_self(tree: ast.AST) -> set[str]:
    """Names that classes of a test file give to themselves."""
    attributes = (node for node in ast.walk(tree) if isinstance(node, ast.Attribute))
    return {node.attr for node in attributes if isinstance(node.value, ast.Name) and node.value.id == "self"}


def _touches(test: ast.AST, private: set[str], own: set[str]) -> bool:
    names = {node.id for node in ast.walk(test) if isinstance(node, ast.Name)}
    attributes = {node.attr for node in ast.walk(test) if isinstance(node, ast.Attribute)} - own - PUBLIC_OF_OTHERS
    return bool(names & private) or any(name[0] == "_" and name[:2] != "__" for name in attributes)


def _straddles(test: ast.FunctionDef, thresholds: list[float]) -> bool:
    """Whether two cases of a parameter stand at a threshold from both sides, by 1 or a tenth: one may be it."""
    for values in (column for decorator in test.decorator_list for column in _columns(decorator)):
        for limit in thresholds:
            near = [value for value in values if abs(value - limit) <= max(0.1 * abs(limit), float(limit % 1 == 0))]
            if near and min(near) <= limit <= max(near) and min(near) < max(near):
                return True
    return False


def _columns(decorator: ast.expr) -> Iterator[list[float]]:
    """The numbers that each parameter of a ``parametrize`` takes."""
    if isinstance(decorator, ast.Call) and len(decorator.args) > 1 and isinstance(decorator.args[1], ast.List):
        rows = [row.elts if isinstance(row, ast.Tuple) else [row] for row in decorator.args[1].elts]
        for column in zip(*rows, strict=False):
            yield [number for cell in column for number in _number(cell)]


def _modules(sources: Sources) -> dict[str, str]:
    """Text of each module of the three packages, by its dotted name."""
    found = {}
    for path, text in sources.items():
        parts = path.removesuffix(".py").split("/")
        if parts[0] in PACKAGES:
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = text
    return found


def room_imports(modules: Mapping[str, str]) -> dict[str, set[str]]:
    """The rooms, and which other rooms each imports; gse itself, a door to gse.api, is none."""
    below = {name: text for name, text in modules.items() if name != "gse"}
    rooms: dict[str, set[str]] = {_room(name): set() for name in below}
    for name, text in below.items():
        for target in _imported(text, modules):
            if _room(target) not in (_room(name), "gse"):
                rooms[_room(name)].add(_room(target))
    return rooms


def _room(module: str) -> str:
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "gse" else parts[0]


def _imported(text: str, modules: Mapping[str, str]) -> Iterator[str]:
    """Modules of ours that a text imports, also inside functions."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            submodules = [f"{node.module}.{name.name}" for name in node.names]
            yield from (name if name in modules else node.module for name in submodules if node.module in modules)
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name in modules)


def floors(imports: Mapping[str, set[str]]) -> dict[str, int]:
    """The floor of each room: 0 where it imports none, else one above the highest that it imports."""
    floor: dict[str, int] = {}

    def climb(room: str, above: frozenset[str]) -> int:
        if room not in floor:
            below = [climb(other, above | {room}) for other in imports[room] if other not in above]
            floor[room] = 1 + max(below, default=-1)
        return floor[room]

    for room in imports:
        climb(room, frozenset())
    return floor


def _reachable(imports: Mapping[str, set[str]], start: str) -> set[str]:
    """All rooms that a room imports, directly or through others."""
    found: set[str] = set()
    waiting = list(imports[start])
    while waiting:
        room = waiting.pop()
        if room not in found:
            found.add(room)
            waiting += imports[room]
    return found


def _classes(modules: Mapping[str, str]) -> Counter[str]:
    """How many modules define a class of each name."""
    trees = (ast.parse(text) for text in modules.values())
    return Counter(node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef))


def _functions(modules: Mapping[str, str]) -> Iterator[Longest]:
    """Every function, from ``def`` to its last line, docstring included."""
    for name, text in modules.items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno:
                yield Longest(f"{name}.{node.name}", node.end_lineno - node.lineno + 1)


def print_rooms(sources: Sources) -> None:
    """The rooms from the highest floor down."""
    imports = room_imports(_modules(sources))
    floor_of = floors(imports)
    for room in sorted(imports, key=lambda room: (-floor_of[room], room)):
        print(f"{floor_of[room]:2}  {room:22} -> {', '.join(sorted(imports[room])) or '-'}")


class Walk:
    """Files and functions of this tree that ran, on any thread, while it was open."""

    def __init__(self) -> None:
        self._below = tuple(f"{ROOT / package}/" for package in PACKAGES)
        self.functions: set[tuple[str, str, int]] = set()

    def __enter__(self) -> "Walk":
        threading.setprofile(self._see)
        sys.setprofile(self._see)
        return self

    def __exit__(self, *error: object) -> None:
        sys.setprofile(None)
        threading.setprofile(None)

    def __str__(self) -> str:
        return f"{len({file for file, _, _ in self.functions})} / {len(self.functions)}"

    def _see(self, frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(self._below) and not code.co_name.startswith("<"):
            self.functions.add((code.co_filename, code.co_name, code.co_firstlineno))


def print_walks() -> None:
    """Files and functions that run: what is done once in a process was done before, but for the campaign's session."""
    from gse.campaign.dataset import DataSet
    from gse.campaign.engine import plan_campaign
    from gse.campaign.judging import judge_source
    from gse.campaign.sources import find_sources
    from gse.sessions.replay import replay_session
    from gse.station.loop import StationLoop
    from gse.verdict.assessment import judge

    print("| golden replay | chunk to result: files / functions | verdict | session of a campaign |\n|---|---|---|---|")
    take = StationLoop.take
    for name in WALKED:
        path = ROOT / "replays" / "golden" / f"{name}.mcap"
        judge(replay_session(path).session)
        chunk, verdict, campaign = Walk(), Walk(), Walk()

        def traced(loop: StationLoop, items: Any, chunk: Walk = chunk) -> Any:
            with chunk:
                return take(loop, items)

        StationLoop.take = traced  # type: ignore[method-assign]
        session = replay_session(path).session
        StationLoop.take = take  # type: ignore[method-assign]
        with verdict:
            judge(session)
        with tempfile.TemporaryDirectory() as folder:
            planned = plan_campaign(find_sources([str(path)]), DataSet.at(f"{folder}/data", create=True))
            with campaign:
                judge_source(planned.todo[0], planned.job)
        print(f"| {name} | {chunk} | {verdict} | {campaign} |")


def main() -> None:
    if "--walks" in sys.argv:
        print_walks()
        return
    if "--rooms" in sys.argv:
        print_rooms(tree())
        return
    before = sys.argv[1] if len(sys.argv) > 1 else BEFORE
    rows = zip(structure_of(revision(before)).rows(), structure_of(tree()).rows(), strict=True)
    print(f"| | before ({before}) | after |\n|---|---|---|")
    for (name, old), (_, new) in rows:
        print(f"| {name} | {old} | {new} |")


if __name__ == "__main__":
    main()

"""The three packages are ours, and stand side by side."""

import itertools
import re
import tomllib
from graphlib import TopologicalSorter
from importlib import metadata
from pathlib import Path

import grimp
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import drivers
import gse
import protocols

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def folder_of(package: object) -> Path:
    return Path(str(package.__file__)).parent  # type: ignore[attr-defined]


def test_the_three_packages_are_neighbours() -> None:
    assert folder_of(drivers).parent == folder_of(gse).parent == folder_of(protocols).parent


def test_no_module_imports_itself_by_way_of_others_not_even_within_functions() -> None:
    """import-linter looks at rooms; its graph has the modules too, with all imports wherever they stand."""
    graph = grimp.build_graph("gse", "drivers", "protocols")
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    assert sum(map(len, imports.values())) > 1000
    TopologicalSorter(imports).prepare()  # CycleError names the circle


def test_every_folder_with_code_is_packaged() -> None:
    packaged = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    there = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for name in ("gse", "drivers", "protocols")
        for path in (ROOT / name).rglob("__init__.py")
    }
    assert packaged == there


def test_type_checkers_of_those_who_use_them_see_the_types() -> None:
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    for package in (drivers, gse, protocols):
        assert (folder_of(package) / "py.typed").exists()
        assert "py.typed" in data[package.__name__]


def test_the_version_is_the_one_that_was_built() -> None:
    assert gse.__version__ == metadata.version("gse-star-sensor")


def test_readme_contributing_classifiers_and_workflow_name_the_same_pythons() -> None:
    of_classifiers = [text.rpartition(" ")[2] for text in PROJECT["classifiers"] if re.search(r"Python :: 3\.\d", text)]
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))["jobs"]
    (of_linux,) = (step["with"]["python-version"] for step in jobs["linux"]["steps"] if "with" in step)
    assert of_classifiers == ["3.11", "3.12", "3.13"]
    assert sorted(of_linux.split()) == of_classifiers
    assert jobs["laptops"]["strategy"]["matrix"]["python"] == of_classifiers
    for name in ("README.md", "CONTRIBUTING.md"):
        (sentence,) = re.findall(r" Python (3[\d., or]+[\d])(?: and|,) git", (ROOT / name).read_text(encoding="utf-8"))
        assert re.findall(r"3\.\d+", sentence) == of_classifiers
    assert PROJECT["requires-python"] == ">=3.11"


def test_every_dependency_is_in_the_tested_set() -> None:
    """Else the file is older than pyproject.toml: ``.ci/constraints`` writes it anew."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = [Requirement(line) for line in lines if not line.startswith("#")]
    asked = [*PROJECT["dependencies"], *itertools.chain(*PROJECT["optional-dependencies"].values())]
    for needed in map(Requirement, asked):
        there = [of.specifier for of in pinned if of.name == canonicalize_name(needed.name)]
        releases = [str(specifier).removeprefix("==") for specifier in there]
        assert releases or needed.name == PROJECT["name"], needed
        assert all(needed.specifier.contains(release) for release in releases), needed


def test_the_application_is_not_for_upload() -> None:
    assert "Private :: Do Not Upload" in PROJECT["classifiers"]


def test_every_dependency_has_its_reason() -> None:
    reasons = (ROOT / "docs" / "dependencies.md").read_text()
    for requirement in PROJECT["dependencies"]:
        name = requirement.split(">")[0].split("=")[0].split("<")[0]
        assert f"| {name} |" in reasons, name

"""The three packages are ours, and stand side by side."""

import tomllib
from importlib import metadata
from pathlib import Path

import drivers
import gse
import protocols

ROOT = Path(__file__).parents[1]


def folder_of(package: object) -> Path:
    return Path(str(package.__file__)).parent  # type: ignore[attr-defined]


def test_the_three_packages_are_neighbours() -> None:
    assert folder_of(drivers).parent == folder_of(gse).parent == folder_of(protocols).parent


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


def test_the_application_is_not_for_upload() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert "Private :: Do Not Upload" in project["classifiers"]


def test_every_dependency_has_its_reason() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    reasons = (ROOT / "docs" / "dependencies.md").read_text()
    for requirement in project["dependencies"]:
        name = requirement.split(">")[0].split("=")[0].split("<")[0]
        assert f"| {name} |" in reasons, name

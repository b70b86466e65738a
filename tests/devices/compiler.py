"""The system's C compiler as a device: shared libraries for the border of gse_identifier.h."""

import shutil
import subprocess
from importlib import resources
from pathlib import Path

import pytest


def shared_library(source: Path | str, folder: Path, name: str = "onboard") -> Path:
    """A shared library of a C file, or of C text; the test is skipped where the system has no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("this system has no C compiler")
    if isinstance(source, str):
        path = folder / f"{name}.c"
        path.write_text(source)
    else:
        path = source
    library = folder / f"{name}.so"
    header = str(resources.files("gse.external"))
    warnings = ["-w"] if isinstance(source, str) else ["-Wall", "-Wextra", "-Werror"]
    command = [compiler, "-std=c99", "-O2", *warnings, "-shared", "-fPIC", f"-I{header}"]
    subprocess.run([*command, str(path), "-o", str(library), "-lm"], check=True)
    return library

"""Compiled functions, kept on disk between runs."""

import importlib.util
import os
from pathlib import Path

from gse.jit import is_on_disk

_SOURCE = """
from gse.jit import compiled

@compiled
def double(x):
    return 2 * x
"""


def test_machine_code_is_on_disk_once_a_function_ran_until_its_source_changes(tmp_path: Path) -> None:
    source = tmp_path / "doubling.py"
    source.write_text(_SOURCE, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("doubling", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert not is_on_disk(module.double)
    assert module.double(2) == 4
    assert is_on_disk(module.double)
    later_ns = source.stat().st_mtime_ns + 10_000_000_000
    os.utime(source, ns=(later_ns, later_ns))
    assert not is_on_disk(module.double)


def test_a_function_that_is_not_compiled_has_nothing_to_wait_for() -> None:
    assert is_on_disk(len)

"""pyarrow without pandas, which it imports with its first array wherever pandas is installed: 40 MiB, 0.25 s."""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from types import ModuleType


class _NoPandas(MetaPathFinder):
    def find_spec(self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        if fullname == "pandas":
            raise ModuleNotFoundError(fullname)


def spare_pandas() -> None:
    """Let pyarrow find no pandas in its only look for it. A later ``import pandas`` still finds it."""
    import pyarrow as pa

    if "pandas" in sys.modules:
        return
    blind = _NoPandas()
    sys.meta_path.insert(0, blind)
    try:
        pa.array([])
    finally:
        sys.meta_path.remove(blind)

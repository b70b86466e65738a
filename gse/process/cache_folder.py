"""A folder of this program below the user's cache directory, for what can be made again but takes time."""

import os
import tempfile
from pathlib import Path

from platformdirs import user_cache_dir


def cache_folder(*names: str) -> Path:
    """Where it is, or would be."""
    return Path(user_cache_dir("gse"), *names)


def own_cache_folder(*names: str) -> Path | None:
    """The folder, made where it is not there; None where it cannot be written, or is another user's.

    What lies there is believed, and machine code runs: so nobody else may write there.
    """
    folder = cache_folder(*names)
    return folder if takes_files(folder) and _is_ours(folder) else None


def takes_files(folder: Path) -> bool:
    """Whether a file can be made in a folder, which is made where it is not there."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _is_ours(folder: Path) -> bool:
    """Whether this user owns it; Windows has a cache directory for each user, which others cannot write."""
    return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()

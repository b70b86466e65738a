"""``python -m gse`` is ``gse``."""

from gse.cli import main

main()

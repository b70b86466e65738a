"""How long a test waits for what must come."""

PATIENCE_S = 300.0
"""Only something broken makes a test wait so long; a busy machine may first have to compile, for minutes."""

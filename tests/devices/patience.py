"""How long a test waits for what must come."""

PATIENCE_S = 120.0
"""Only something broken makes a test wait so long; a busy machine may take a hundred times as long as an idle one."""

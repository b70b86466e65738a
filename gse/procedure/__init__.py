"""A test by a procedure: the supply, the file, the steps, the as-run log."""

"""Solvers from PyPI as identifiers under test: entry points of the group gse.identifiers."""

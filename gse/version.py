"""The version of the program, from which pyproject.toml takes it: a source tree knows it without an installation."""

__version__ = "0.1.0"

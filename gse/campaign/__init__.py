"""Campaigns: many sessions judged on a Dask cluster into a Parquet data set, and their report.

A leaf of the results: may import sessions, report, evaluation and all below; only cli imports it. Its packages are the
optional ``[campaign]`` of pyproject.toml: modules that need them are imported when a campaign command runs.
"""

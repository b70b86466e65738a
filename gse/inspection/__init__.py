"""Inspection of bytes, equipment and installation: ``gse decode``, ``gse preflight`` and ``gse selfcheck``.

May not import sessions or cli.
"""

"""Inspection of recorded bytes and of the equipment: ``gse decode`` and ``gse preflight``.

May not import sessions or cli.
"""

"""What lies on the wire, and what stands ready: ``gse decode`` and ``gse preflight``.

May not import sessions or cli.
"""

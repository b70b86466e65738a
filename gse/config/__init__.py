"""The station file: read and validated once, changed without losing its comments.

May import no other room but those of the lowest floor. Below ``gse.sessions`` and ``gse.station.setup``, functions take
a Camera, a Site, a Mount or Limits and not the whole station file.
"""

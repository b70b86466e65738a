"""The station file: read and validated once, changed without losing its comments.

May import no other room but values. Its sections become values (Camera, Site, Mount, Limits, IdentifierOptions), which
functions take instead of the whole station file.
"""

"""The station file: read and validated once, changed without losing its comments.

May import no other room. What it reads become values of their own (Camera, Site, Mount, Limits, IdentifierOptions), which
functions below take instead of the whole station file.
"""

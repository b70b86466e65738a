"""Sources of a session (live, replay, commands) and products of recorded ones (export, golden reports).

Only cli may import it.
"""

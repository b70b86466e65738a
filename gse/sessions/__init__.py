"""Sources of a session (live, replay, commands) and products of recorded ones (export, golden reports).

Only cli, api and campaign may import it.
"""

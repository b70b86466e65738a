"""The ways to get a session: live, by replay, by commands; and what is made of recorded ones (export, golden reports).

Only cli may import it.
"""

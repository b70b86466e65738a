"""The verdict of a session, how long a session must be for one, and the comparison of two sessions.

Reads ``SessionData``. May not import report, sessions or cli: it decides, others show and write.
"""

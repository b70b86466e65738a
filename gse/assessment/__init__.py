"""From a finished session to its verdict: statistics, truth uncertainty budget, diagnosis, comparison of sessions.

Reads ``SessionData``. May not import report, sessions or cli: it decides, others show and write.
"""

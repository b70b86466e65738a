"""Statistics of a session: which frames count, what they show of each subject, how well truth and figures are known.

Reads ``SessionData``. Decides no verdict and looks for no cause: the rooms above do.
"""

"""The live view in rerun, its web page, saved views, and the status line of the terminal.

Takes results as a ``Listener`` behind a queue that drops: a view can never delay the measurement. May not import
assessment, report, sessions or cli.
"""

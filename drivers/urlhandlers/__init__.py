"""The package in which pyserial finds the handlers of ``replay://`` and ``sim://``.

pyserial turns an ImportError inside a handler into "protocol not known": a test imports each.
"""

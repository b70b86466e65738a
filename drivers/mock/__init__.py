"""The mock ports behind ``sim://`` and ``replay://``: pyserial ports whose bytes carry their own time."""

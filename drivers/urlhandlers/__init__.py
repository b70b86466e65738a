"""The package that pyserial searches for the handlers of ``replay://`` and ``sim://``; nothing else imports it by name."""

"""The session file as the station fills it: topics, attachments, the recorder, and tools for recorded files.

May not import station: it keeps bytes and JSON, and does not know what a result is.
"""

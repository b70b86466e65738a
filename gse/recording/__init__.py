"""Session files of the station: topics, attachments, recorder, and tools for recorded files.

May not import station: it stores bytes and JSON without knowledge of results.
"""

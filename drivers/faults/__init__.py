"""Seeded faults of cable, adapter and computer, put into a stream of chunks. Imports no port and no clock."""

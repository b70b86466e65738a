"""The way of a panorama: bytes with host times in, results against sidereal truth out, one plain loop on one thread.

May import identifier, truth, recording and below; never assessment, view, report, sessions or cli.
"""

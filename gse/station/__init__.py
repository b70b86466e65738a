"""Processing of panoramas: bytes with host times in, results against sidereal truth out, in one loop on one thread.

May import identifier, truth, recording and below; never verdict, view, report, sessions or cli.
"""

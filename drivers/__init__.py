"""The serial side of the station: ports, session files, and the mock ports that stand in for a sensor.

Chunks of bytes with their UTC go in and out; ``protocols`` decodes them. Imports neither gse nor protocols. Only
``drivers.link`` and ``drivers.clock`` read the host clock. Part of gse-star-sensor, which gse/process/own_packages.py
looks for here.
"""

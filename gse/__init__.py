"""The ground test station for a star sensor: panoramas in, RA and DE against sidereal truth out.

Each package is a room, named after its part in the way of a panorama; the modules that lie here are values and
functions that many rooms share. ARCHITECTURE.md is the plan.
"""

"""Somebody else's identifier on trial: a command, a C library or a Python entry point, each in a child process.

docs/external-identifiers.md has the contract. What goes in is what the sensor measured; what comes back is data, a
time-out too. A child never gets the station's environment, descriptors or terminal; that is not a sandbox. May not
import station, truth or a built-in identifier.
"""

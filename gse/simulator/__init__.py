"""The simulated sensor: sky, optics, detector and firmware behind ``sim://`` and ``gse emulate``.

May never import ``gse.truth`` (a contract of its own): its sky is astropy's, so that each tests the other.
"""

from gse.simulator.device import device_factory

__all__ = ["device_factory"]

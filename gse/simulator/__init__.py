"""Simulated sensor: sky, panoramas and firmware, independent of gse.truth."""

from gse.simulator.device import device_factory

__all__ = ["device_factory"]

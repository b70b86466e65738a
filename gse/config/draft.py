"""A commented station file from a few answers."""

import math
from dataclasses import dataclass

from gse.config.station import parse_station


@dataclass(frozen=True, slots=True, kw_only=True)
class Draft:
    """What a station file cannot do without. Without ``azimuth_deg`` the mount is fitted on the first minute."""

    name: str = "LAPAN-like"
    rows: int = 1024
    columns: int = 1024
    field_of_view_deg: float = 14.0
    """Along a row of the image."""
    site: str = "rooftop"
    latitude_deg: float = -6.53
    longitude_deg: float = 106.70
    height_m: float = 250.0
    azimuth_deg: float | None = 0.0
    altitude_deg: float = 90.0
    roll_deg: float = 0.0
    port: str = "sim://"
    baudrate: int = 115200
    protocol: str = "panorama-v1"

    @property
    def focal_length_px(self) -> float:
        """Of a lens with this field of view, in pixels."""
        return self.columns / 2 / math.tan(math.radians(self.field_of_view_deg / 2))


def draft_text(draft: Draft) -> str:
    """The text of the station file; ConfigError where a value cannot be."""
    text = f"""\
# Station file. Every key: docs/station-file.md. Check it: gse config check FILE
version: 1
sensor:
  name: {_quoted(draft.name)}
  rows: {draft.rows}
  columns: {draft.columns}
  # {draft.field_of_view_deg:g} deg along a row. From a data sheet: focal length in mm / pixel size in mm.
  # gse calibrate finds it from a session to a few parts in ten thousand.
  focal_length_px: {draft.focal_length_px:.3f}
  mirrored: false            # true where the image is a mirror image of the sky
site:
  name: {_quoted(draft.site)}
  latitude_deg: {draft.latitude_deg!r:12}# north is positive; 0.0001 deg is 0.4 arcsec of error
  longitude_deg: {draft.longitude_deg!r:11}# east is positive
  height_m: {draft.height_m:g}
  # uncertainty: {{position_m: 3}}   # how well a survey knows the place, 95 %
  # Air for refraction; without these keys: the standard atmosphere at this height.
  # pressure_hpa: 985        # at the site, not reduced to sea level
  # temperature_c: 25
  # relative_humidity: 0.8
{_mount(draft)}
port:
  url: {_quoted(draft.port)}
  baudrate: {draft.baudrate}
protocol: {_quoted(draft.protocol)}      # or the path of a YAML description: docs/protocols.md
limits:
  d_ra_cosde_arcsec: 60      # the limit of the LAPAN paper: 1 arcmin
  d_de_arcsec: 60
  identification_ms: 200
"""
    parse_station(text, "the new station file")
    return text


def _mount(draft: Draft) -> str:
    if draft.azimuth_deg is None:
        return """\
mount:
  # The first minute of stars tells where the sensor looks; absolute pointing, site and clock are not tested then.
  align: first 60 s"""
    return f"""\
mount:                       # where the sensor looks; gse align finds the angles from a session
  azimuth_deg: {draft.azimuth_deg!r:14}# from north through east
  altitude_deg: {draft.altitude_deg!r:13}# above the horizon; the zenith is 90
  roll_deg: {draft.roll_deg!r:17}# image up from the direction of the zenith, counter-clockwise
  # How well a survey knows them, half-widths that hold the truth with 95 %. Only what is stated here can show that a
  # turned sensor is not a turned mount: docs/uncertainty.md
  # uncertainty: {{azimuth_arcsec: 5, altitude_arcsec: 4, roll_arcsec: 20}}"""


def _quoted(text: str) -> str:
    """As YAML, whatever it holds."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'

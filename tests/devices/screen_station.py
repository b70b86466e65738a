"""A station with a screen before its sensor: the sensor has the screen's own pixels."""

from gse.config.station import parse_station

STATION = parse_station("""\
version: 1
sensor: {name: lab, rows: 1080, columns: 1920, focal_length_px: 5000}
site: {name: lab, latitude_deg: 48, longitude_deg: 11, height_m: 500}
mount: {inertial: {ra_deg: 83, de_deg: -2, roll_deg: 20}}
screen: {pixel_pitch_mm: 0.1, columns: 1920, rows: 1080, focal_length_mm: 500, latency_ms: 30}
""")

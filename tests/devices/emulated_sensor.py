"""The emulated sensor as a device under test: a TCP port, and a supply that a program switches by a file."""

import sys
import threading
from pathlib import Path

from drivers.clock import read_clock
from gse.config.station import parse_station
from gse.simulator.device import detector_of, firmware_of, scenario_of
from gse.simulator.emulator import Emulator, TcpEndpoint
from gse.values.instant import to_text

SWITCH = """\
import pathlib, sys, time
supply, what = pathlib.Path(sys.argv[1]), sys.argv[2]
if what == "read":
    print("5.02 V 310 mA" if supply.read_text() == "on" else "0 0")
elif what == "hang":
    time.sleep(600)
elif what == "fail":
    sys.exit("no such relay")
elif what == "lie":
    print("switched")
else:
    supply.write_text(what)
    print("relay", what)
"""
STATION = """\
version: 1
sensor: {name: ST-1, rows: 1024, columns: 1024, focal_length_px: 4170}
site: {name: roof, latitude_deg: -6.53, longitude_deg: 106.7, height_m: 250}
"""


class EmulatedSensor:
    """Sends from power-on while the file ``supply`` says on; a context manager. ``station`` is its station file."""

    def __init__(self, folder: Path, *, on: str = "on", off: str = "off") -> None:
        self._endpoint = TcpEndpoint("127.0.0.1", 0)
        self.supply = folder / "supply"
        self.supply.write_text("on")
        switch = folder / "switch.py"
        switch.write_text(SWITCH)
        commands = {key: [sys.executable, str(switch), str(self.supply), word] for key, word in
                    (("on", on), ("off", off), ("read", "read"))}  # fmt: skip
        self.station = folder / "station.yaml"
        power = ", ".join(f"{key}: {command}" for key, command in commands.items())
        self.station.write_text(
            f"{STATION}port: {{url: '{self._endpoint.address}'}}\n"
            f"power: {{{power}, settle_s: 0.2, period_s: 0.2, timeout_s: 2}}\n"
        )
        options = {"scenario": "clear-zenith", "start": to_text(read_clock().utc_ns, 9)}
        device = parse_station(STATION)
        scenario = scenario_of(options, device)
        scenario = scenario.model_copy(
            update={
                "air": scenario.air.model_copy(update={"sunlight": False}),
                "firmware": scenario.firmware.model_copy(update={"boot_s": 0.5}),
            }
        )
        detector = detector_of(device, scenario, options)
        detector.expose(scenario.start_utc_ns, scenario.exposure_s, 20.0)  # loads what it needs
        self._firmware = firmware_of(device, scenario, options, detector, read_clock().utc_ns, is_test=True)
        self._is_on, self._is_over = True, False
        emulator = Emulator(self._firmware, self._endpoint, lambda: read_clock().utc_ns, baudrate=115200)
        self._thread = threading.Thread(target=emulator.run, args=(self._looks,), daemon=True)

    def _looks(self) -> bool:
        on = self.supply.read_text() != "off"
        if on != self._is_on:
            self._is_on = on
            self._firmware.switch(read_clock().utc_ns, on=on)
        return self._is_over

    def unplug(self) -> None:
        """End it: its port is gone for good."""
        self._is_over = True
        self._thread.join()
        self._endpoint.close()

    def __enter__(self) -> "EmulatedSensor":
        self._thread.start()
        return self

    def __exit__(self, *raised: object) -> None:
        if not self._is_over:
            self.unplug()

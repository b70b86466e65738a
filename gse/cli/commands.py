"""The commands, in the order of ``gse --help``: what each does, with the two examples that its help ends with.

A command is a module of its own beside this one; a new one gets a line in COMMANDS and one in EXAMPLES.
"""

COMMANDS = {
    "run": "test a sensor: receive, record, identify, compare, judge",
    "status": "show a running session, or end it with --stop",
    "note": "record a line of text in a running session",
    "replay": "do the same from a session or a raw capture",
    "report": "write the report of a session",
    "why": "show one page on a session: what happened, why, what next",
    "view": "show a session in rerun",
    "identify": "identify one panorama table: stars, RA, DE, roll",
    "extract": "extract a panorama table from an image, as the sensor does",
    "evaluate": "test identifiers by Monte-Carlo over the whole sky",
    "simulate": "write a simulated session",
    "emulate": "simulate a sensor on a pseudo-terminal or a TCP port",
    "calibrate": "fit focal length, principal point, distortion, mirror and hot pixels",
    "align": "fit the direction of the mount",
    "compare": "compare sessions, or one session under two identifiers",
    "conventions": "name the convention of the sensor's own answers",
    "session": "show, verify, recover, trim or export a session",
    "decode": "list the frames and the discarded bytes of a session or raw capture",
    "config": "write, check or show a station file",
    "catalog": "show the star catalogue in use",
    "ports": "list the serial ports and the programs that hold them",
    "preflight": "check that everything is ready for a session",
    "sensor": "send a command to the sensor",
    "plan": "show how much longer a session must be for a verdict",
    "selfcheck": "check the installation with sessions of known errors",
    "campaign": "judge many sessions on a cluster, report on them, query them",
    "ci": "replay a folder of sessions and compare their reports or answers",
    "completion": "print the script that completes commands in a shell",
}

EXAMPLES = {
    "gse": ("gse run", "gse run --help"),
    "run": (
        "gse run --view web",
        "gse run --station roof.yaml --port /dev/ttyUSB0 --duration 30m",
    ),
    "status": ("gse status", "gse status --stop sessions/20260320T183000Z-ST-1"),
    "replay": (
        "gse replay sessions/20260320T183000Z-ST-1/session.mcap --identifier pivot",
        "gse replay capture.bin --station roof.yaml --start-utc 2026-03-20T18:30:00Z",
    ),
    "report": ("gse report sessions/20260320T183000Z-ST-1", "gse report sessions/20260320T183000Z-ST-1 --pdf"),
    "view": ("gse view session.mcap --web", "gse view session.mcap --screenshot session.png"),
    "identify": (
        "gse identify panorama.csv --station roof.yaml",
        "gse identify panorama.csv --station roof.yaml --json",
    ),
    "extract": ("gse extract image.fits", "gse extract image.png --out panorama.csv"),
    "evaluate": ("gse evaluate --frames 1000", "gse evaluate --preset lapan"),
    "simulate": ("gse simulate --list", "gse simulate --scenario clear-zenith --seconds 600"),
    "emulate": ("gse emulate --pty", "gse emulate --tcp 127.0.0.1:4000 --station roof.yaml"),
    "calibrate": ("gse calibrate session.mcap", "gse calibrate session.mcap --write calibrated.yaml"),
    "align": ("gse align session.mcap", "gse align session.mcap --write aligned.yaml"),
    "compare": ("gse compare before.mcap after.mcap", "gse compare session.mcap --identifier pivot"),
    "session": ("gse session info session.mcap", "gse session verify session.mcap"),
    "decode": ("gse decode session.mcap --explain", "gse decode capture.bin --protocol sensor.yaml"),
    "config": ("gse config init roof.yaml", "gse config check roof.yaml"),
    "catalog": ("gse catalog info", "gse catalog info --station roof.yaml"),
    "ports": ("gse ports", "gse ports --json"),
    "preflight": ("gse preflight --station roof.yaml", "gse preflight --station roof.yaml --hours 8"),
    "sensor": ("gse sensor status --station roof.yaml", "gse sensor exposure 0.2 --station roof.yaml"),
    "plan": ("gse plan", "gse plan session.mcap"),
    "selfcheck": ("gse selfcheck", "gse selfcheck --json"),
    "ci": ("gse ci replays --update", 'gse ci replays --identifier "command:./onboard"'),
    "campaign": (
        "gse campaign judge 'nights/*' --to dataset",
        'gse campaign query dataset "select night, verdict from sessions"',
    ),
    "why": ("gse why sessions/20260320T183000Z-ST-1", "gse why session.mcap --bundle case.zip"),
    "conventions": (
        "gse conventions sessions/20260320T183000Z-sensor",
        "gse conventions sessions/20260320T183000Z-sensor --json",
    ),
    "note": ('gse note "clouds from the west"', 'gse note "dew on the lens" sessions/20260320T183000Z-ST-1'),
    "session info": ("gse session info sessions/20260320T183000Z-ST-1", "gse session info session.mcap --json"),
    "session verify": ("gse session verify session.mcap", "gse session verify session.mcap --json"),
    "session recover": ("gse session recover session.mcap", "gse session recover session.mcap --out whole.mcap"),
    "session trim": (
        "gse session trim session.mcap --from 2026-03-20T18:30:00Z --out part.mcap",
        "gse session trim session.mcap --to 2026-03-20T19:00:00Z",
    ),
    "session export": (
        "gse session export session.mcap --format parquet --out tables",
        "gse session export session.mcap --format mcap --out results.mcap",
    ),
    "config init": ("gse config init roof.yaml", "gse config init roof.yaml --yes --port /dev/ttyUSB0"),
    "config check": ("gse config check roof.yaml", "gse config check roof.yaml --at 2026-03-20T18:30:00Z"),
    "config show": ("gse config show", "gse config show roof.yaml --json"),
    "catalog info": ("gse catalog info", "gse catalog info --station roof.yaml"),
    "catalog export": (
        "gse catalog export --station roof.yaml --flight flight.csv",
        "gse catalog export --station roof.yaml --list stars.csv",
    ),
    "sensor start": (
        "gse sensor start --station roof.yaml",
        "gse sensor start --period 0.1 --port /dev/ttyUSB0",
    ),
    "sensor stop": ("gse sensor stop --station roof.yaml", "gse sensor stop --port /dev/ttyUSB0"),
    "sensor status": ("gse sensor status --station roof.yaml", "gse sensor status --port /dev/ttyUSB0 --json"),
    "sensor request": ("gse sensor request --station roof.yaml", "gse sensor request --port /dev/ttyUSB0"),
    "sensor exposure": (
        "gse sensor exposure 0.2 --station roof.yaml",
        "gse sensor exposure 0.05 --port /dev/ttyUSB0",
    ),
    "campaign judge": (
        "gse campaign judge 'nights/*' --to dataset",
        "gse campaign judge 'nights/*' --to dataset --scheduler tcp://10.0.0.1:8786",
    ),
    "campaign report": ("gse campaign report dataset", "gse campaign report dataset --out campaign --pdf"),
    "campaign query": (
        'gse campaign query dataset "select night, verdict from sessions"',
        'gse campaign query dataset "select count(*) from sessions" --format json',
    ),
    "completion": ("gse completion bash >> ~/.bashrc", "gse completion fish > ~/.config/fish/completions/gse.fish"),
}


def epilog(name: str) -> str | None:
    r"""The last part of a help text; ``\b`` keeps click from filling the lines anew."""
    examples = EXAMPLES.get(name)
    return "\n".join(["\b", "Examples:", *(f"  {example}" for example in examples)]) if examples else None

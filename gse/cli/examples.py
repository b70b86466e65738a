"""Two examples at the end of each command's help."""

EXAMPLES = {
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
        "gse identify panorama.csv --json",
    ),
    "extract": ("gse extract image.fits", "gse extract image.png --out panorama.csv"),
    "evaluate": ("gse evaluate --frames 1000", "gse evaluate --preset lapan"),
    "simulate": ("gse simulate --list", "gse simulate --scenario clear-zenith --seconds 600"),
    "emulate": ("gse emulate --pty", "gse emulate --tcp 127.0.0.1:4000 --station roof.yaml"),
    "calibrate": ("gse calibrate session.mcap", "gse calibrate session.mcap --write roof.yaml"),
    "align": ("gse align session.mcap", "gse align session.mcap --write roof.yaml"),
    "compare": ("gse compare before.mcap after.mcap", "gse compare session.mcap --identifier pivot"),
    "session": ("gse session info session.mcap", "gse session verify session.mcap"),
    "decode": ("gse decode session.mcap --explain", "gse decode capture.bin --protocol sensor.yaml"),
    "config": ("gse config init roof.yaml", "gse config check roof.yaml"),
    "catalog": ("gse catalog info", "gse catalog info --station roof.yaml"),
    "ports": ("gse ports", "gse ports --json"),
    "preflight": ("gse preflight --station roof.yaml", "gse preflight --station roof.yaml --hours 8"),
    "sensor": ("gse sensor status --station roof.yaml", "gse sensor exposure 0.2 --station roof.yaml"),
    "plan": ("gse plan --noise 10arcsec --tau 3s --rate 10Hz", "gse plan session.mcap"),
    "selfcheck": ("gse selfcheck", "gse selfcheck --json"),
    "ci": ("gse ci replays", "gse ci replays --update"),
    "campaign": (
        "gse campaign judge 'nights/*' --to dataset",
        'gse campaign query dataset "select night, verdict from sessions"',
    ),
    "why": ("gse why sessions/20260320T183000Z-ST-1", "gse why session.mcap --bundle case.zip"),
    "conventions": ("gse conventions session.mcap", "gse conventions session.mcap --json"),
    "note": ('gse note "clouds from the west"', 'gse note "dew on the lens" sessions/20260320T183000Z-ST-1'),
    "completion": ("gse completion bash >> ~/.bashrc", "gse completion fish > ~/.config/fish/completions/gse.fish"),
}


def epilog(name: str) -> str | None:
    r"""The last part of a help text; ``\b`` keeps click from filling the lines anew."""
    examples = EXAMPLES.get(name)
    return "\n".join(["\b", "Examples:", *(f"  {example}" for example in examples)]) if examples else None

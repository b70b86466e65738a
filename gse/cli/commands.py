"""The commands, in the order of ``gse --help``: what each does, the two examples that its help ends with, its options
that only ``--help-all`` shows, names that options had before, and options that are gone.

A command is a module of its own beside this one; a new one gets a line in COMMANDS and one in EXAMPLES.
"""

from collections.abc import Mapping

import click

COMMANDS = {
    "run": "test a sensor: receive, record, identify, compare, judge",
    "procedure": "run a test by its steps, with one report",
    "status": "show a running session, or end it with --stop",
    "note": "record a line of text in a running session",
    "replay": "do the same from a session or a raw capture",
    "report": "write the report of a session",
    "sessions": "list the recorded sessions with their verdicts",
    "why": "show one page on a session: what happened, why, what next",
    "view": "show a session in rerun",
    "identify": "identify one panorama table or picture: stars, RA, DE, roll",
    "extract": "extract a panorama table from an image, as the sensor does",
    "evaluate": "test identifiers by Monte-Carlo over the whole sky",
    "simulate": "write a simulated session",
    "emulate": "simulate a sensor, or play a session, on a terminal, TCP or serial port",
    "calibrate": "fit focal length, principal point, distortion, mirror and hot pixels",
    "align": "fit the direction of the mount",
    "compare": "compare sessions, or one session under two identifiers",
    "conventions": "name the convention of the sensor's own answers",
    "session": "show, verify, recover, trim, export or import a session",
    "decode": "list the frames and the discarded bytes of a session or raw capture",
    "protocol": "check the description or the class of a wire format",
    "config": "write, check or show a station file",
    "catalog": "show the star catalogue in use",
    "ports": "list the serial ports and the programs that hold them",
    "preflight": "check that everything is ready for a session",
    "sensor": "send a command to the sensor",
    "screen": "show stars on a monitor before the sensor",
    "alarms": "try the alarms of a station file",
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
        "gse run roof.yaml --port /dev/ttyUSB0 --duration 30m",
    ),
    "procedure": ("gse procedure init test.yaml", "gse procedure run test.yaml"),
    "procedure run": ("gse procedure run test.yaml --view web", "gse procedure run test.yaml --answers answers.yaml"),
    "procedure check": ("gse procedure check test.yaml", "gse procedure check tests/roof.yaml"),
    "procedure init": ("gse procedure init test.yaml", "gse procedure init starts.yaml acquisition"),
    "status": ("gse status", "gse status --stop sessions/20260320T183000Z-ST-1"),
    "replay": (
        "gse replay sessions/20260320T183000Z-ST-1/session.mcap --identifier pivot",
        "gse replay capture.bin --station roof.yaml --start-utc 2026-03-20T18:30:00Z",
    ),
    "report": ("gse report", "gse report sessions/20260320T183000Z-ST-1 --pdf"),
    "view": ("gse view --view web", "gse view session.mcap --out session.png"),
    "identify": (
        "gse identify panorama.csv --station roof.yaml",
        "gse identify panorama.csv --station roof.yaml --json",
    ),
    "extract": ("gse extract image.fits", "gse extract --sub-pixel picture.jpg --out panorama.csv"),
    "evaluate": ("gse evaluate --frames 1000", "gse evaluate --preset lapan"),
    "simulate": ("gse simulate --list", "gse simulate --scenario clear-zenith --seconds 600"),
    "emulate": ("gse emulate --pty", "gse emulate --tcp 127.0.0.1:4000 --station roof.yaml"),
    "calibrate": ("gse calibrate session.mcap", "gse calibrate session.mcap --write calibrated.yaml"),
    "align": ("gse align session.mcap", "gse align session.mcap --write aligned.yaml"),
    "compare": ("gse compare before.mcap after.mcap", "gse compare session.mcap --identifier pivot"),
    "session": ("gse session info session.mcap", "gse session verify session.mcap"),
    "decode": ("gse decode session.mcap --explain", "gse decode capture.bin --protocol sensor.yaml"),
    "protocol": ("gse protocol check my-sensor.yaml", "gse protocol check panorama-v1"),
    "protocol check": ("gse protocol check my-sensor.yaml", "gse protocol check ccsds-packets --json"),
    "config": ("gse config init roof.yaml", "gse config check roof.yaml"),
    "catalog": ("gse catalog info", "gse catalog info --station roof.yaml"),
    "ports": ("gse ports", "gse ports --json"),
    "preflight": ("gse preflight --station roof.yaml", "gse preflight --station roof.yaml --hours 8"),
    "screen": ("gse screen --station lab.yaml", "gse screen --station lab.yaml --scene scenes.yaml"),
    "sensor": ("gse sensor send PING --station roof.yaml", "gse sensor send SET_EXPOSURE exposure=200ms"),
    "alarms": ("gse alarms test --station roof.yaml", "gse alarms test -s roof.yaml"),
    "alarms test": ("gse alarms test --station roof.yaml", "gse alarms test -s roof.yaml"),
    "plan": ("gse plan", "gse plan session.mcap"),
    "selfcheck": ("gse selfcheck", "gse selfcheck --json"),
    "ci": ("gse ci replays --update", 'gse ci replays --identifier "command:./onboard"'),
    "campaign": (
        "gse campaign judge 'nights/*' --out dataset",
        'gse campaign query dataset "select night, verdict from sessions"',
    ),
    "sessions": ("gse sessions", "gse sessions nights --json"),
    "why": ("gse why", "gse why session.mcap --bundle case.zip"),
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
    "session import": (
        "gse session import capture.bin -s roof.yaml --start-utc 2026-03-20T18:30:00Z",
        "gse session import capture.bin --start-utc 2026-03-20T18:30:00Z",
    ),
    "session export": (
        "gse session export session.mcap --format parquet --out tables",
        "gse session export session.mcap --format mcap --out results.mcap",
    ),
    "config init": ("gse config init roof.yaml", "gse config init roof.yaml --yes --port /dev/ttyUSB0"),
    "config check": ("gse config check roof.yaml", "gse config check roof.yaml --start-utc 2026-03-20T18:30:00Z"),
    "config show": ("gse config show", "gse config show roof.yaml --json"),
    "catalog info": ("gse catalog info", "gse catalog info --station roof.yaml"),
    "catalog export": (
        "gse catalog export --station roof.yaml --flight flight.csv",
        "gse catalog export --station roof.yaml --list stars.csv",
    ),
    "sensor send": (
        "gse sensor send PING --station roof.yaml",
        "gse sensor send SET_EXPOSURE exposure=200ms --port /dev/ttyUSB0",
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
        "gse campaign judge 'nights/*' --out dataset",
        "gse campaign judge 'nights/*' --out dataset --scheduler tcp://10.0.0.1:8786",
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


# Options that a first session does not need: ``--help-all`` shows them, too. They work like all others.

_LIVE = ("--bind", "--http-port", "--save-rrd", "--json-frames")
_JUDGED = ("--earth-orientation", "--plots", "--paper")
ADVANCED: Mapping[str, tuple[str, ...]] = {
    "run": (
        "--starts",
        "--off",
        "--station",
        *_LIVE,
        *_JUDGED,
        "--identifier",
        "--scene",
        "--rates",
        "--wait-port",
        "--json",
    ),
    "procedure run": (
        *("--station", "--from", "--answers", "--operator", "--view", "--out", "--plots", "--paper", "--json"),
        *("--verbose", *_LIVE),
    ),
    "replay": (*_LIVE, *_JUDGED, "--leave-out", "--start-utc", "--address"),
    "report": (*_JUDGED, "--start-utc", "--anew", "--screenshot"),
    "why": ("--with-site", "--clock-error"),
    "view": ("--bind", "--http-port", "--clock-error"),
    "evaluate": (
        *("--magnitude-noise", "--missing", "--whole-pixels", "--limit", "--seed", "--workers", "--scheduler"),
        *("--catalog", "--panoramas", "--figures", "--sky-to"),
    ),
    "simulate": ("--rate-hz", "--seed", "--level", "--faults", "--file"),
    "emulate": ("--seed", "--rate-hz", "--standby", "--start-utc", "--level", "--port", "--shift", "--faults"),
    "calibrate": ("--from", "--to", "--start-utc", "--tangential"),
    "align": ("--from", "--to", "--start-utc", "--accept-gross"),
    "compare": ("--sigmas", "--allow", "--bias-is-regression", "--start-utc", "--anew"),
    "conventions": ("--seconds", "--start-utc"),
    "config init": (
        *("--rows", "--columns", "--field-of-view-deg", "--latitude-deg", "--longitude-deg", "--height-m"),
        *("--azimuth-deg", "--altitude-deg", "--roll-deg", "--baudrate"),
    ),
    "preflight": ("--earth-orientation", "--out"),
    "sensor send": ("--out", "--session"),
    **{
        f"sensor {name}": ("--json", "--out", "--session")
        for name in ("exposure", "request", "start", "status", "stop")
    },
    "campaign judge": ("--scheduler", "--workers", "--session-limit", "--rehash"),
    "ci": ("--within", "--speed"),
    "catalog info": ("--fewer-than", "--magnitude"),
    "protocol check": ("--seed",),
}

OLD_NAMES: Mapping[tuple[str, str], tuple[str, str | None]] = {
    ("view", "--web"): ("view", "web"),
    ("view", "--save"): ("out", None),
    ("view", "--screenshot"): ("out", None),
    ("simulate", "--start"): ("start", None),
    ("emulate", "--start"): ("start", None),
    ("preflight", "--at"): ("begins_ns", None),
    ("config check", "--at"): ("begins_ns", None),
    ("campaign judge", "--to"): ("dataset_url", None),
}
"""The parameter that an old name of an option sets, and to which value where it was a flag; for one release."""

_SHOWS_ALL = "--help-all"


def dressed(name: str, command: click.Command) -> click.Command:
    """A command, and those below it, with examples, old names, and ``--help-all`` where it has advanced options."""
    if command.epilog is not None:
        return command  # of an earlier call
    command.epilog = epilog(name)
    if isinstance(command, click.Group):
        for below, one in command.commands.items():
            dressed(f"{name} {below}", one)
    advanced = [param for param in _options(command) if set(param.opts) & set(ADVANCED.get(name, ()))]
    command.params += [_old_name(old, *of) for (owner, old), of in OLD_NAMES.items() if owner == name]
    if advanced:
        command.params.append(_help_all(advanced))
    return command


def _options(command: click.Command) -> list[click.Option]:
    return [param for param in command.params if isinstance(param, click.Option)]


def _help_all(advanced: list[click.Option]) -> click.Option:
    """The option that shows ``advanced`` ones, which the help hides otherwise."""
    for option in advanced:
        option.hidden = True

    def show(ctx: click.Context, param: click.Parameter, asked: bool) -> None:
        if asked:
            click.echo(whole_help(ctx))
            ctx.exit()

    help_text = f"Show {len(advanced)} more option{'s' if len(advanced) > 1 else ''}, too."
    return click.Option([_SHOWS_ALL], is_flag=True, is_eager=True, expose_value=False, callback=show, help=help_text)


def whole_help(ctx: click.Context) -> str:
    """The help of a command with its advanced options."""
    advanced = [option for option in _options(ctx.command) if option.hidden and not _is_old(option)]
    for option in advanced:
        option.hidden = False
    try:
        return ctx.get_help()
    finally:
        for option in advanced:
            option.hidden = True


def _is_old(option: click.Option) -> bool:
    return not option.expose_value


def _old_name(old: str, target: str, value: str | None) -> click.Option:
    """An option by the name that it had: it sets the parameter ``target``, to ``value`` where it was a flag."""

    def hand_on(ctx: click.Context, param: click.Parameter, given: str | bool | None) -> None:
        if given:
            ctx.default_map = {**(ctx.default_map or {}), target: value or given}

    is_flag = value is not None
    names = [old, f"old_{old.lstrip('-')}"]
    return click.Option(names, is_flag=is_flag, hidden=True, is_eager=True, expose_value=False, callback=hand_on)


_PLAN = "'gse plan SESSION' plans from a recorded session; without one 'gse preflight' says how long a session must be"
_THREADS = "leave it out: a replay chooses itself, and its results are the same"

RETIRED = {
    ("gse ci", "--cut"): "leave it out; 'gse run --port replay://FILE?cut=37' receives a session in pieces of 37 bytes",
    ("gse replay", "--expect"): (
        "'gse ci FOLDER --identifier X' compares with NAME.answers.ndjson, 'gse compare FILE --with-sensor' with what "
        "the sensor sent"
    ),
    ("gse replay", "--loop"): "'gse run --port replay://FILE?loop=3' receives a session three times in a row",
    ("gse replay", "--step"): "'gse view FILE' goes from frame to frame, 'gse replay FILE --json-frames' prints each",
    ("gse replay", "--threads"): _THREADS,
    ("gse report", "--threads"): _THREADS,
    **{
        ("gse plan", option): _PLAN
        for option in (
            *("--station", "--noise", "--roll-noise", "--tau", "--error", "--limit", "--truth", "--rate"),
            "--availability",
        )
    },
}
"""By command and option, the sentence that names what does now what it did: exit code 2, and that sentence."""


def retired(command: str, option: str) -> str | None:
    """What does now what an option did; None where there was no such option."""
    sentence = RETIRED.get((command, option))
    return None if sentence is None else f"'{' '.join(filter(None, (command, option)))}' is retired: {sentence}"

"""``gse evaluate``: Monte-Carlo over the whole sky."""

import itertools
import json
import math
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gse.catalog import load_catalog
from gse.cli import EXIT_INTERRUPTED, was_interrupted
from gse.cli.campaign import require_packages
from gse.cli.options import IDENTIFIER, PLUG_HELP, NewFolder, station_option
from gse.cli.progress import ProgressBar
from gse.config.choice import station_of, with_identifier
from gse.errors import UsageError

if TYPE_CHECKING:
    from gse.evaluation.paper_figures import PaperSky
    from gse.evaluation.plan import FrameOutcome, OutcomeCounter, Plan


# The tables of ``gse evaluate`` for a person, within 80 columns.

_NOISE_HEAD = f"{'identifier':11}{'arcsec':>7}{'mag':>4}"


def table(document: dict[str, Any]) -> list[str]:
    """The report for a person, within 80 columns: shares with their intervals, then frames and times."""
    from gse.evaluation.plan import KINDS, failure_lines

    is_paper = document["angle_noise"]
    shares = _shares_by_sky(document) if is_paper else _shares(document)
    about, kind = (f"{'sky to':>11}", "step 2") if is_paper else (f"{'false':>6}{'miss':>5}", KINDS[3])
    rest = [_NOISE_HEAD + about + f"{'frames':>9}{'few':>5}{kind + ' %':>9}{'median':>8}{'p95':>8}{'max ms':>8}"]
    for cell in document["cells"]:
        about, rates, cpu_ms = _noise(cell) + _faults(cell), cell["rates"], cell["cpu_ms"]
        few = sum(cell["excluded"].values())
        line = (
            f"{about}{cell['frames_counted']:9d}{few:5d}{_step_2(cell) if is_paper else _percent(rates[KINDS[3]], 9)}"
        )
        rest.append(line + f"{_ms(cpu_ms['median']):>8}{_ms(cpu_ms['p95']):>8}{_ms(cpu_ms['max']):>8}")
    few_false = sum(cell["excluded"]["false"] for cell in document["cells"])
    return [
        *shares,
        "",
        *rest,
        "",
        f"shares of the frames with at least {document['fewest_stars']} real stars, with 95 % bounds",
        f"few: frames with fewer stars; false answers in them: {few_false}",
        *(["step 2: right among the stars that the second step named"] if is_paper else []),
        "times: CPU time of one call, all frames; of an external identifier its own,",
        "otherwise by this host's clock",
        *failure_lines(document["cells"]),
        *_distinct_star(document),
    ]


def _shares(document: dict[str, Any]) -> list[str]:
    from gse.evaluation.plan import KINDS

    lines = [_NOISE_HEAD + f"{'false':>6}{'miss':>5}" + "".join(f"{kind + ' %':>20}" for kind in KINDS[:2])]
    lines[0] += f"{KINDS[2] + ' %':>7}"
    for cell in document["cells"]:
        intervals = "".join(f"{_interval(cell['rates'][kind]):>20}" for kind in KINDS[:2])
        lines.append(_noise(cell) + _faults(cell) + intervals + _percent(cell["rates"][KINDS[2]], 7))
    return lines


def _shares_by_sky(document: dict[str, Any]) -> list[str]:
    """The shares of the pivot paper's conditions, a column for each sky."""
    skies = list(dict.fromkeys(cell["sky_limit"] for cell in document["cells"]))
    head = f"{'right %':>19}{'false %':>8}"
    lines = [
        " " * len(_NOISE_HEAD) + "".join(f"{f'sky to {sky:g} mag':>{len(head)}}" for sky in skies),
        _NOISE_HEAD + head * len(skies),
    ]
    for cells in zip(*[iter(document["cells"])] * len(skies), strict=True):
        shares = [(_interval(cell["rates"]["right"], digits=1), _percent(cell["rates"]["false"], 8)) for cell in cells]
        lines.append(_noise(cells[0]) + "".join(f"{right:>19}{false}" for right, false in shares))
    return lines


def _step_2(cell: dict[str, Any]) -> str:
    named, right = cell["step_2"]["named"], cell["step_2"]["right"]
    return f"{100 * right / named:9.2f}" if named else f"{'-':>9}"


def _distinct_star(document: dict[str, Any]) -> list[str]:
    """Eqs 1 and 2 of the pivot paper in words, where the document has them."""
    found = document.get("distinct_star")
    if found is None:
        return []
    band = "in Gaia's G, which is not V" if document["catalog"] == "gaia" else "in its own magnitudes"
    return [
        f"eq 1: {found['fields_eq_1']:.0f} fields; eq 2: {found['stars_eq_2_to_4_5']:.0f} stars to magnitude 4.5, "
        f"and one a field to {found['magnitude']:.2f};",
        f"the source has {found['stars']} to there, {band};",
        f"{100 * found['fields_with_one']:.1f} % of the fields have one",
    ]


def _noise(cell: dict[str, Any]) -> str:
    return f"{cell['identifier']:11.11}{cell['noise_arcsec']:7g}{cell['magnitude_noise']:4g}"


def _faults(cell: dict[str, Any]) -> str:
    if cell["sky_limit"] is not None:
        return f"{cell['sky_limit']:11g}"
    return f"{cell['false_objects']:6d}{cell['missing_share']:5g}"


def _interval(rate: dict[str, Any], digits: int = 2) -> str:
    if rate["share"] is None:
        return "-"
    low, high = rate["interval"]
    return f"{100 * rate['share']:.{digits}f} [{100 * low:.1f} {100 * high:.1f}]"


def _percent(rate: dict[str, Any], width: int) -> str:
    return f"{'-':>{width}}" if rate["share"] is None else f"{100 * rate['share']:{width}.2f}"


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}" if value < 100 else f"{value:.0f}"


BENCHMARK = ("robust", "neighbour", "pivot", "match-group")
"""The identifiers of --panoramas."""

_COLUMNS = 80
"""Width of a terminal in characters."""
_NOISE_ARCSEC, _NOISE_MAGNITUDE, _LIMIT = 10.0, 0.3, 6.0


class _Finite(click.FloatRange):
    """A range that NaN is not in."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value} is not a number between {self.min:g} and {self.max:g}", param, ctx)
        return number


@click.command("evaluate")
@station_option
@click.option(
    "--identifier",
    "identifiers",
    multiple=True,
    type=IDENTIFIER,
    help=f"Identifier to test; repeatable. {PLUG_HELP}  [default: robust]",
)
@click.option("--preset", type=click.Choice(("pivot-paper", "lapan")), help="Use the settings of a paper.")
@click.option(
    "--frames", type=click.IntRange(1, 1_000_000_000), default=1000, show_default=True, help="Number of directions."
)
@click.option(
    "--noise-arcsec",
    multiple=True,
    type=_Finite(0, 3600),
    help="Noise of positions, 1 sigma per axis; repeatable.  [default: 10]",
)
@click.option(
    "--magnitude-noise",
    multiple=True,
    type=_Finite(0, 5),
    help="Noise of magnitudes, 1 sigma; repeatable.  [default: 0.3]",
)
@click.option(
    "--false-objects",
    multiple=True,
    type=click.IntRange(0, 30),
    help="False objects per frame; repeatable.  [default: 0]",
)
@click.option("--missing", type=_Finite(0, 1), help="Share of missing stars.  [default: 0]")
@click.option("--whole-pixels/--sub-pixel", default=None, help="Precision of positions.  [default: --whole-pixels]")
@click.option("--limit", type=_Finite(2, 10), help="Magnitude limit of the sensor.  [default: 6]")
@click.option(
    "--sky-to",
    "sky_limit",
    type=_Finite(2, 10),
    help="With --preset pivot-paper: faintest star of the second sky.  [default: 7.5]",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of all noise.")
@click.option("--workers", type=click.IntRange(1, 256), default=1, show_default=True, help="Number of processes.")
@click.option("--scheduler", help="Address of a Dask scheduler whose workers do the work, e.g. tcp://127.0.0.1:8786.")
@click.option(
    "--catalog", type=click.Path(path_type=Path, dir_okay=False), help="Star catalogue; default: that of the station."
)
@click.option(
    "--panoramas",
    "folders",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Benchmark on the panoramas of this folder, which has a truth.json, beside seeded ones; repeatable.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="One JSON object, schema gse.evaluation/1 (--panoramas: gse.benchmark/1)."
)
@click.option("--figures", type=NewFolder(), help="Write plots (SVG) to this folder.")
@click.pass_context
def command(
    ctx: click.Context,
    /,
    *,
    workers: int,
    scheduler: str | None,
    as_json: bool,
    figures: Path | None,
    folders: tuple[Path, ...],
    **options: Any,
) -> None:
    """Measure how often identifiers are right, over directions spread evenly on the sky, and their CPU time.

    An answer is right if its boresight is within 0.05 deg; coarse if most stars are right and it is 0.05 to 0.5 deg
    off; any other answer is false. Shares are those of frames with at least 4 real stars. The same seed gives the
    same answers on any number of workers, here or of a Dask cluster. Ctrl-C ends early with the frames done so far,
    exit code 130.

    --preset pivot-paper, the settings of the pivot paper: noise on each angle between stars of an 8 deg circular field,
    tolerance 3 sigma, frames with 3 stars or more; an answer is right if its first star is. The limit is V = 6.0, or
    5.7 in the embedded catalogue, which has as many stars. It is done under two skies: one that ends at this limit, by
    which the paper's figures are met, and one to 7.5. With --figures also the paper's figures 2 to 7, 9 and 10.

    --preset lapan, a field like that of the LAPAN sensor. The paper's are whole pixels, 30 objects and 1.5 px; ours,
    because it states none, are 14 x 14 deg, 1024 x 1024 px, 10 arcsec, 0.3 mag, 0, 3 and 8 false objects, Fn 6.

    --panoramas FOLDER scores identifiers, built-in or external, on panoramas of the real sky (or anybody's) beside the
    seeded ones: success, false answers, none, boresight error and time in one table.
    """
    from gse.evaluation.plan import report

    if folders:
        _benchmark(folders, options, as_json=as_json)
        return
    plan, note = _plan(options)
    if figures is not None:
        _refuse_existing(figures, plan)
    counter, interrupted = _run(plan, workers, scheduler)
    document = report(plan, counter.tallies(), interrupted=interrupted)
    sky = _paper_sky(plan)
    if sky is not None:
        document["distinct_star"] = sky.distinct_star()
    if as_json:
        click.echo(json.dumps(document))
    else:
        lines = [part for line in note.splitlines() for part in textwrap.wrap(line, _COLUMNS)]
        click.echo("\n".join([*lines, *table(document)]))
    if figures is not None:
        _write_figures(document, figures, plan, sky)
    if interrupted:
        click.echo("interrupted: the result is that of the frames done so far", err=True)
        ctx.exit(EXIT_INTERRUPTED)


def _paper_sky(plan: "Plan") -> "PaperSky | None":
    """The sky of the pivot paper, where the plan is of angles between stars."""
    from gse.evaluation.paper_figures import PaperSky

    return PaperSky.from_plan(plan) if plan.angle_noise else None


def _refuse_existing(folder: Path, plan: "Plan") -> None:
    from gse.evaluation.paper_figures import FIGURES, refuse_existing

    refuse_existing(folder, *(FIGURES if plan.angle_noise else ()))


def _write_figures(document: dict[str, Any], folder: Path, plan: "Plan", sky: "PaperSky | None") -> None:
    from gse.evaluation.paper_figures import write_figures, write_sky_figures

    paths = write_figures(document, folder)
    paths += write_sky_figures(sky, plan.frames, folder) if sky is not None else []
    for path in paths:
        click.echo(f"{path} written", err=True)


def _benchmark(folders: tuple[Path, ...], options: dict[str, Any], *, as_json: bool) -> None:
    """Every identifier on every set of panoramas: those of the folders, and seeded ones."""
    from gse.evaluation.panoramas import SCHEMA, benchmark, read_set, seeded_set, table

    if options["preset"]:
        raise UsageError("--panoramas has its own cameras; leave out --preset")
    sets = [read_set(folder) for folder in folders]
    options = {**options, "identifiers": options["identifiers"] or BENCHMARK}
    plan, _ = _plan(options)
    identifiers = list(dict.fromkeys(cell.identifier for cell in plan.cells))
    source = load_catalog(plan.catalog)
    sets += [seeded_set(plan, cell, source) for cell in plan.cells if cell.identifier == identifiers[0]]
    rows = list(benchmark(identifiers, sets, plan.catalog))
    click.echo(json.dumps({"schema": SCHEMA, "seed": plan.seed, "rows": rows}) if as_json else "\n".join(table(rows)))


def _plan(options: dict[str, Any]) -> tuple["Plan", str]:
    """The plan that the options ask for, and one line about it."""
    from gse.evaluation.frames import Conditions, Optics
    from gse.evaluation.plan import GAIA_LIMIT, PRESETS, Cell, Plan

    preset = PRESETS[options["preset"]] if options["preset"] else None
    if preset and options["station_path"]:
        raise UsageError("--preset has its own camera; leave out --station or --preset")
    station, text = station_of(options["station_path"])
    catalog = str(options["catalog"]) if options["catalog"] else station.catalog
    if preset:
        optics, base, names, angles = preset.optics, preset.conditions, preset.identifiers, preset.angle_noise
        if angles and catalog == "gaia":
            optics = replace(optics, magnitude_limit=GAIA_LIMIT)
    else:
        optics = Optics(station.sensor.name, station.sensor.camera(), _LIMIT)
        base, names, angles = (Conditions("own", _NOISE_ARCSEC, _NOISE_MAGNITUDE),), ("robust",), False
    if options["limit"] is not None:
        optics = replace(optics, magnitude_limit=options["limit"])
    names = options["identifiers"] or names
    if angles:
        _refuse_for_angles(options)
    skies = _skies(optics.magnitude_limit, options["sky_limit"], angles=angles)
    cells = [
        Cell(with_identifier(station, text, name)[0].identifier, conditions, sky)
        for name in dict.fromkeys(names)
        for conditions in _conditions(base, options)
        for sky in skies
    ]
    note = f"{optics.name}, to magnitude {optics.magnitude_limit:g}, {options['frames']} frames, seed {options['seed']}"
    plan = Plan(optics, tuple(cells), options["frames"], options["seed"], catalog, angles)
    return plan, f"{note}\n{preset.note}" if preset else note


def _skies(limit: float, asked: float | None, *, angles: bool) -> list[float]:
    """Where the skies end: for angles at the limit of the catalogue, and further on."""
    from gse.evaluation.plan import SKY_LIMIT

    if asked is not None and (not angles or asked < limit):
        raise UsageError(
            f"--sky-to {asked:g} is for --preset pivot-paper, and as faint as its limit or fainter; other skies go on "
            "to the end of the catalogue anyway"
        )
    return sorted({limit, max(limit, SKY_LIMIT) if asked is None else asked}) if angles else [math.inf]


def _conditions(base: tuple[Any, ...], options: dict[str, Any]) -> list[Any]:
    """The base conditions with what was asked for otherwise, every value with every other, none twice."""
    sweeps = {
        "position_arcsec": options["noise_arcsec"],
        "magnitude": options["magnitude_noise"],
        "false_objects": options["false_objects"],
        "missing_share": () if options["missing"] is None else (options["missing"],),
        "whole_pixels": () if options["whole_pixels"] is None else (options["whole_pixels"],),
    }
    given = {key: values for key, values in sweeps.items() if values}
    swept = (
        replace(conditions, **dict(zip(given, values, strict=True)))
        for values in itertools.product(*given.values())
        for conditions in base
    )
    return list(dict.fromkeys(swept))


def _refuse_for_angles(options: dict[str, Any]) -> None:
    """UsageError where an option has no meaning for angles between stars."""
    for name in options["identifiers"]:
        if name not in ("pivot", "match-group"):
            raise UsageError(f"--preset pivot-paper works with pivot and match-group only, not with {name}")
    for name in ("false_objects", "missing", "whole_pixels"):
        if options[name] not in (None, ()):
            raise UsageError(
                "--preset pivot-paper has no pixels and no false or missing objects; leave out --false-objects, "
                "--missing, --whole-pixels and --sub-pixel"
            )


def _run(plan: "Plan", workers: int, scheduler: str | None) -> tuple["OutcomeCounter", bool]:
    """All outcomes counted, or those until Ctrl-C, with progress on stderr."""
    from gse.evaluation.plan import OutcomeCounter

    counter = OutcomeCounter(plan)
    try:
        with ProgressBar("evaluating", plan.frames * len(plan.cells)) as bar:
            for chunk in _outcomes(plan, workers, scheduler):
                bar.advance(counter.add(chunk))
    except KeyboardInterrupt:
        return counter, True
    except SystemError as error:
        if not was_interrupted(error):
            raise
        return counter, True
    return counter, False


def _outcomes(plan: "Plan", workers: int, scheduler: str | None) -> Iterator[list["FrameOutcome"]]:
    from gse.evaluation.monte_carlo import outcomes

    if scheduler is None:
        return outcomes(plan, workers)
    if workers != 1:
        raise UsageError("--scheduler has workers of its own; leave out --workers or --scheduler")

    require_packages()
    from gse.campaign.cluster import outcomes_on

    return outcomes_on(scheduler, plan)

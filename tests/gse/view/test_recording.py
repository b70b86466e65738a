"""What a recording for rerun holds, read back row by row."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun
import rerun.error_utils
from devices.items_sensor import ITEMS
from devices.rerun_recording import moving, rows_of
from rerun.chunk import RrdReader
from skies.one_by_one import Made, result_of, results_of
from skies.synthetic_night import small_catalog, synthetic_frames, synthetic_night

from drivers.chunk import LinkEvent
from gse.errors import UsageError
from gse.station.columns import FRAME, STATUSES
from gse.station.housekeeping import ITEM, Housekeeping
from gse.station.results import Status
from gse.station.session_tables import FrameTable
from gse.values.instant import NS_PER_S
from gse.view.blueprint import _title, layout
from gse.view.rerun_columns import GRAPHS, MEAN_S, near_rows
from gse.view.saved_view import save_view
from gse.view.scene import Scene

FRAMES = 700


@pytest.fixture(autouse=True)
def _strict() -> None:
    """rerun only warns where it is used wrongly, unless it is told to raise."""
    rerun.error_utils.set_strict_mode(True)


@pytest.fixture(scope="module")
def frames():
    return list(synthetic_frames(FRAMES))


@pytest.fixture(scope="module")
def rows(frames, tmp_path_factory: pytest.TempPathFactory):
    path = tmp_path_factory.mktemp("view") / "night.rrd"
    session = synthetic_night(FRAMES)
    save_view(session, small_catalog(), path, "FAIL", ["mean |dRA*| is 75.0 arcsec, the limit is 60"])
    return rows_of(path)


def values(rows, path: str) -> np.ndarray:
    return np.array([row["Scalars:scalars"] for row in moving(rows[path])])


def test_each_frame_is_one_row_of_each_series_at_its_own_instant(rows, frames) -> None:
    for path in ("/d_ra/value", "/d_de/value", "/cross", "/roll", "/identification_ms", "/temperature_c"):
        assert len(moving(rows[path])) == FRAMES, path
    utc_ns = [row["utc"] for row in moving(rows["/d_ra/value"])]
    assert utc_ns == [frame.panorama.utc_ns for frame in frames]


@pytest.mark.parametrize("graph", GRAPHS)
def test_a_declared_graph_has_its_columns_and_a_place_on_the_screen(rows, tmp_path: Path, graph) -> None:
    frames, per_unit = synthetic_night(FRAMES).frames.columns, 1000 if graph == "identification_ms" else 1
    drawn = np.column_stack([frames[column.name].astype(np.float64) for column in GRAPHS[graph]])
    assert np.allclose(values(rows, f"/{graph}"), drawn / per_unit, atol=0.0006, equal_nan=True)
    (style,) = [row for row in rows[f"/{graph}"] if row["static"]]
    assert len(style["SeriesLines:colors"]) == len(style["SeriesLines:names"]) == len(GRAPHS[graph])
    layout(synthetic_night(1).station).save("gse", str(tmp_path / "layout.rbl"))
    reader = RrdReader(str(tmp_path / "layout.rbl"))
    batches = [chunk.to_record_batch() for chunk in reader.stream(store=reader.blueprints()[0]).to_chunks()]
    origins = [batch["ViewBlueprint:space_origin"].to_pylist() for batch in batches if _has_origin(batch)]
    assert [[f"/{graph}"]] in origins


def _has_origin(batch: Any) -> bool:
    return "ViewBlueprint:space_origin" in batch.schema.names


def test_a_graph_without_a_title_is_called_by_its_name() -> None:
    assert _title("boresight_drift_arcsec") == "Boresight drift (arcsec)"
    assert _title("transparency") == "Transparency"


def test_errors_stand_between_their_limits_and_a_frame_without_answer_is_a_gap(rows, frames) -> None:
    found = values(rows, "/d_ra/value")
    expected = [math.nan if f.attitude_error is None else f.attitude_error.d_ra_cosde_arcsec for f in frames]
    assert np.allclose(found[:, 0], expected, atol=0.0006, equal_nan=True)
    assert np.isnan(found[49, 0])
    assert (found[:, 1:] == [60, -60]).all()


@pytest.mark.parametrize("live", [False, True])
def test_no_line_is_drawn_across_an_outage(tmp_path: Path, live) -> None:
    slow, path = list(synthetic_frames(4, rate_hz=0.1)), tmp_path / "outage.rrd"
    session = synthetic_night(4)
    stream = rerun.RecordingStream("gse", send_properties=False)
    stream.set_sinks(rerun.FileSink(str(path)))
    scene = Scene(stream, session.station, None, live=live)
    for batch in (slow[:2], slow[2:3], slow[3:]):
        scene.add(list(results_of(batch)), pictures=len(batch))
    stream.disconnect()
    series = moving(rows_of(path)["/d_ra/value"])
    breaks = [row["utc"] for row in series if math.isnan(row["Scalars:scalars"][0])]
    assert breaks == [frame.panorama.utc_ns + 1 for frame in slow[:3]]
    assert all(row["Scalars:scalars"][1:] == [60, -60] for row in series)


def test_the_sky_track_goes_on_after_the_clock_was_set_back(tmp_path: Path) -> None:
    path, session = tmp_path / "back.rrd", synthetic_night(4)
    first, last = session.frames.columns.rows(slice(0, 2)), session.frames.columns.rows(slice(2, 4))
    last["utc_ns"] -= 3600 * NS_PER_S
    stream = rerun.RecordingStream("gse", send_properties=False)
    stream.set_sinks(rerun.FileSink(str(path)))
    scene = Scene(stream, session.station, None, live=True)
    for columns in (first, last):
        scene.add_columns(columns)
    stream.disconnect()
    assert moving(rows_of(path)["/sky/measured"])


def test_only_frames_outside_the_limit_are_marked(rows) -> None:
    assert values(rows, "/d_ra/outside").ravel().tolist() == [75.0] * (FRAMES // 211)
    assert moving(rows["/d_de/outside"]) == []


def test_tooltips_show_milliarcseconds_and_no_more(rows) -> None:
    for path in ("/d_ra/value", "/cross", "/roll"):
        found = values(rows, path)
        assert np.array_equal(found, np.round(found, 3), equal_nan=True)


def test_objects_of_a_panorama_are_told_apart_by_kind(rows, frames) -> None:
    kinds = {kind: moving(rows[f"/panorama/{kind}"]) for kind in ("named", "stars", "unidentified", "hot", "planets")}
    assert all(len(kind) == FRAMES for kind in kinds.values())
    assert kinds["named"][0]["Points2D:labels"] == ["Spica", "Heze", "Apami-Atsa"]
    facts = kinds["stars"][0]["Points2D:labels"][0]
    residual_arcsec = result_of(frames[0]).matches[0].residual_arcsec
    assert facts.startswith(f"{residual_arcsec:.1f} arcsec, ")
    assert facts.endswith(" mag, Spica")
    assert " mag, Spi" in facts[:27]  # rerun cuts the rest beside a star in the left half of the picture
    assert kinds["hot"][0]["Points2D:labels"] == ["hot pixel"]
    assert kinds["planets"][0]["Points2D:labels"] == ["Jupiter"]
    assert np.allclose(kinds["hot"][0]["Points2D:positions"], [[300, 700]])
    shown = sum(len(kinds[kind][0]["Points2D:positions"]) for kind in kinds if kind != "named")
    assert shown == len(frames[0].panorama.brightness)
    assert len(kinds["unidentified"][49]["Points2D:positions"]) == len(frames[49].panorama.brightness)


def test_the_mouse_over_a_star_finds_the_star_and_its_facts(rows, tmp_path: Path) -> None:
    """rerun shows what differs between the points of an entity, and nothing of one with more than 5 components."""
    assert not np.any(moving(rows["/panorama/named"])[0]["Points2D:radii"])
    of_stars = {name for row in rows["/panorama/stars"] for name in row if name.startswith("Points2D:")}
    assert len(of_stars) <= 5
    layout(synthetic_night(1).station).save("gse", str(tmp_path / "layout.rbl"))
    reader = RrdReader(str(tmp_path / "layout.rbl"))
    drawn = {}
    for chunk in reader.stream(store=reader.blueprints()[0]).to_chunks():
        batch = chunk.to_record_batch()
        named = [name for name in batch.schema.names if ":" in name]  # instants may need pandas, which may be spared
        drawn[chunk.entity_path.partition("/overrides")[2]] = {name: batch.column(name)[0].as_py() for name in named}
    for around in ("residuals", "named"):  # arrows and names lie above the stars
        assert drawn[f"/panorama/{around}/visualizers"]["EntityBehavior:interactive"] == [False]
    assert "/panorama/stars/visualizers" not in drawn


def test_stars_keep_their_order_from_frame_to_frame_whatever_their_brightness(tmp_path: Path, frames) -> None:
    """rerun tells the facts of the place that a star had in the frame before."""

    def drawn(frame: Made) -> list[Any]:
        path = tmp_path / "stars.rrd"
        stream = rerun.RecordingStream("gse", send_properties=False)
        stream.set_sinks(rerun.FileSink(str(path)))
        Scene(stream, synthetic_night(1).station, small_catalog(), live=False).add([result_of(frame)], pictures=1)
        stream.disconnect()
        row = moving(rows_of(path)["/panorama/stars"])[0]
        return [row["Points2D:positions"], [facts.rpartition(", ")[2] for facts in row["Points2D:labels"]]]

    frame = frames[0]
    swap = np.arange(len(frame.panorama.brightness))
    swap[:2] = 1, 0  # the second star came out brighter than the first
    panorama = replace(frame.panorama, xy_px=frame.panorama.xy_px[swap])
    swapped = replace(frame, panorama=panorama, matches=replace(frame.matches, objects=swap[frame.matches.objects]))
    assert drawn(swapped) == drawn(frame)
    assert drawn(frame)[1][:2] == ["Spica", "Heze"]


def test_frames_that_come_together_are_pictures_each_with_its_own_objects(tmp_path: Path, frames) -> None:
    """The last of these three has no answer."""
    path = tmp_path / "together.rrd"
    stream = rerun.RecordingStream("gse", send_properties=False)
    stream.set_sinks(rerun.FileSink(str(path)))
    shown = frames[47:50]
    Scene(stream, synthetic_night(1).station, None, live=True).add(list(results_of(shown)), pictures=3)
    stream.disconnect()
    rows = rows_of(path)
    for kind, of_frame in (("stars", [len(frame.matches) for frame in shown]), ("hot", [1, 1, 0])):
        assert [len(row["Points2D:positions"]) for row in moving(rows[f"/panorama/{kind}"])] == of_frame


def test_of_a_long_session_those_frames_are_pictures_that_keep_all_of_their_objects(tmp_path: Path, frames) -> None:
    session, path = synthetic_night(9), tmp_path / "long.rrd"
    table = session.frames
    thinned = FrameTable.with_rows(
        9, *(kept[kept["frame"] % 4 == 0] for kept in (table.matches, table.others)), stride=4
    )
    for name in FRAME.names or ():
        thinned.columns[name] = table.columns[name]
    session.frames = thinned
    save_view(session, small_catalog(), path, "PASS", [])
    rows = rows_of(path)
    shown = [frames[0], frames[4], frames[8]]
    for kind in ("stars", "hot", "residuals"):
        assert [row["utc"] for row in moving(rows[f"/panorama/{kind}"])] == [one.panorama.utc_ns for one in shown]
    assert len(moving(rows["/d_ra/value"])) == 9
    places = [row["Points2D:positions"] for row in moving(rows["/panorama/stars"])]
    for one, found in zip(shown, places, strict=True):
        assert sorted(map(tuple, found)) == sorted(
            map(tuple, one.panorama.xy_px[one.matches.objects].astype(np.float32).tolist())
        )


def test_of_more_pictures_than_are_sent_at_once_each_shows_its_own_objects(tmp_path: Path) -> None:
    """Whatever the order in which the objects of different frames were kept."""
    session, path = synthetic_night(1100, trouble=False), tmp_path / "many.rrd"
    table, last_first = session.frames, np.argsort(-session.frames.matches["frame"], kind="stable")
    session.frames = FrameTable.with_rows(1100, table.matches[last_first], table.others, stride=1)
    for name in FRAME.names or ():
        session.frames.columns[name] = table.columns[name]
    save_view(session, small_catalog(), path, "PASS", [])
    pictures = moving(rows_of(path)["/panorama/stars"])
    assert [row["utc"] for row in pictures] == table.columns["utc_ns"].tolist()
    stars = [table.matches[(table.matches["frame"] == k) & table.matches["named"]] for k in range(1100)]
    for row, of_frame in zip(pictures, stars, strict=True):
        expected = np.column_stack([of_frame["x_px"], of_frame["y_px"]]).astype(np.float32)
        assert set(map(tuple, row["Points2D:positions"])) <= set(map(tuple, expected.tolist()))
        assert row["Points2D:positions"]


def test_frames_without_a_sky_are_left_out_of_the_shares_of_a_saved_view(tmp_path: Path) -> None:
    """The event that says so comes among the frames: what it says holds from there on."""
    session, path = synthetic_night(400, trouble=False), tmp_path / "cloud.rrd"
    rows, cloud = session.frames.columns, slice(200, 320)
    rows["status"][cloud] = STATUSES.index(Status.NO_MATCH)
    for name in ("ra_deg", "de_deg", "d_ra_cosde_arcsec", "d_de_arcsec"):
        rows[name][cloud] = np.nan
    for row, kind in ((210, "CLOUDED"), (330, "CLEAR")):
        session.events.append(LinkEvent(int(rows["utc_ns"][row]), 0, kind, "cloud"))
    save_view(session, small_catalog(), path, "PASS", [])
    (text,) = [row["TextDocument:text"][0] for row in rows_of(path)["/verdict"] if row["static"]]
    assert "100.0 %" in text


def test_brighter_objects_are_drawn_larger(rows, frames) -> None:
    radii = moving(rows["/panorama/stars"])[0]["Points2D:radii"]
    assert radii == sorted(radii, reverse=True)
    assert radii[0] > 1.2 * radii[-1]


def test_residual_arrows_are_a_hundred_times_the_residual(rows, frames) -> None:
    arrow = moving(rows["/panorama/residuals"])[0]
    match = result_of(frames[0]).matches[0]
    pixel_arcsec = math.degrees(math.atan(1 / (512 / math.tan(math.radians(7))))) * 3600
    expected = np.array([match.residual_x_arcsec, match.residual_y_arcsec]) / pixel_arcsec * 100
    assert np.allclose(arrow["Arrows2D:vectors"][0], expected, rtol=1e-3)
    assert np.allclose(arrow["Arrows2D:origins"][0], frames[0].panorama.xy_px[0], rtol=1e-5)


def test_scatter_and_track_hold_every_compared_frame_once(rows, frames) -> None:
    answered = sum(frame.status is Status.IDENTIFIED for frame in frames)
    for path, column in (
        ("/scatter/points", "Points2D:positions"),
        ("/sky/measured", "Points3D:positions"),
        ("/sky/true", "Points3D:positions"),
    ):
        assert sum(len(row[column]) for row in moving(rows[path])) == answered, path


def test_the_scatter_has_d_de_upwards(rows, frames) -> None:
    first = moving(rows["/scatter/points"])[0]["Points2D:positions"][0]
    found = frames[0].attitude_error
    assert np.allclose(first, [found.d_ra_cosde_arcsec, -found.d_de_arcsec], atol=0.01)


def test_the_track_lies_on_the_sphere_where_the_attitude_points(rows, frames) -> None:
    track = moving(rows["/sky/measured"])[0]["Points3D:positions"]
    assert np.allclose(track[0], frames[0].attitude.boresight_icrs, atol=1e-6)


def test_the_rings_are_one_and_three_sigma_about_the_mean(rows, frames) -> None:
    last = moving(rows["/scatter/rings"])[-1]["LineStrips2D:strips"]
    errors = np.array([f.attitude_error.d_ra_cosde_arcsec for f in frames if f.attitude_error])
    for ring, n in zip(last, (1, 3), strict=True):
        assert np.ptp(np.array(ring)[:, 0]) == pytest.approx(2 * n * errors.std(ddof=1), rel=0.01)


def test_the_verdict_is_seen_at_any_time_and_says_why(rows) -> None:
    (text,) = [row["TextDocument:text"][0] for row in rows["/verdict"] if row["static"]]
    assert text.startswith("# FAIL\n- mean |dRA*| is 75.0 arcsec")
    assert f"**{FRAMES}** frames" in text


def test_link_states_and_log_tell_what_happened(rows) -> None:
    states = [row["StateChange:state"][0] for row in moving(rows["/state/link"])]
    assert states == ["waiting", "streaming", "no port", "waiting", "streaming", "closed"]
    log = moving(rows["/log"])[-1]["TextDocument:text"][0].split("\n")
    assert any("LOST: device disconnected" in line for line in log)
    bad, good = "- **18:30:04Z frame 49: NO_MATCH**", "- 18:30:05Z frame 50: IDENTIFIED"
    assert log.index(good) < log.index(bad), "the newest first"


def test_the_clock_is_shown_with_its_bounds_in_milliseconds(rows) -> None:
    assert values(rows, "/clock")[0].tolist() == [0.02, 1.0, -1.0]


def test_an_existing_file_is_not_overwritten_and_an_absent_folder_is_told(tmp_path: Path) -> None:
    session = synthetic_night(1)
    taken = tmp_path / "taken.rrd"
    taken.write_text("mine")
    with pytest.raises(UsageError, match="exists already"):
        save_view(session, None, taken, "PASS", [])
    assert taken.read_text() == "mine"
    with pytest.raises(UsageError, match="No such file or directory"):
        save_view(session, None, tmp_path / "absent" / "night.rrd", "PASS", [])


def test_close_up_an_error_has_the_mean_and_the_spread_of_the_last_twenty_seconds(rows, frames) -> None:
    errors = np.array([math.nan if f.attitude_error is None else f.attitude_error.d_de_arcsec for f in frames])
    seconds = np.array([frame.panorama.utc_ns for frame in frames]) / NS_PER_S
    found = values(rows, "/near/d_de")
    for place in (0, 30, 150, FRAMES - 2):
        last = errors[: place + 1][(seconds[: place + 1] > seconds[place] - MEAN_S)]
        mean, sigma = np.nanmean(last), np.nanstd(last)
        assert found[place] == pytest.approx([errors[place], mean, mean - sigma, mean + sigma], abs=0.01, nan_ok=True)
    assert np.isnan(found[49]).all()
    assert np.nanmax(np.abs(values(rows, "/near/d_ra")[:, 0])) <= 60  # one of 75 is left out


def test_the_running_mean_does_not_depend_on_how_frames_come(rows, tmp_path: Path) -> None:
    session, path = synthetic_night(FRAMES), tmp_path / "pieces.rrd"
    stream = rerun.RecordingStream("gse", send_properties=False)
    stream.set_sinks(rerun.FileSink(str(path)))
    scene = Scene(stream, session.station, None, live=True)
    for begin in range(0, FRAMES, 7):
        scene.add_columns(session.frames.columns.rows(slice(begin, min(begin + 7, FRAMES))))
    stream.disconnect()
    assert np.allclose(values(rows_of(path), "/near/d_ra"), values(rows, "/near/d_ra"), atol=0.002, equal_nan=True)


def test_a_viewer_that_is_open_all_night_costs_no_thread_for_each_piece() -> None:
    session = synthetic_night(FRAMES)
    scene = Scene(rerun.RecordingStream("gse", send_properties=False), session.station, None, live=True)
    place, threads = "", []
    for row in range(20):
        scene.add_columns(session.frames.columns.rows(slice(row, row + 1)))
        piece = scene.piece_after(place)
        assert piece.rrd
        assert piece.place != place
        place = piece.place
        threads.append(len(list(Path("/proc/self/task").iterdir())))
    assert threads[-1] <= threads[0] + 4  # rerun's own pool may grow for a while


def test_twenty_viewers_that_open_get_one_layout_and_cost_no_thread_each(tmp_path: Path) -> None:
    session = synthetic_night(FRAMES)
    scene = Scene(rerun.RecordingStream("gse", send_properties=False), session.station, None, live=True)
    scene.add_columns(session.frames.columns.rows(slice(0, 5)))
    first, before = scene.piece_after(""), len(list(Path("/proc/self/task").iterdir()))
    assert len({scene.piece_after("").layout for _ in range(20)} - {first.layout}) == 0
    assert len(list(Path("/proc/self/task").iterdir())) <= before + 4  # rerun's own pool may grow for a while
    (tmp_path / "layout.rrd").write_bytes(first.layout)
    (blueprint,) = RrdReader(str(tmp_path / "layout.rrd")).blueprints()
    assert blueprint.application_id == "gse"
    assert not scene.piece_after(first.place).layout


def test_what_a_viewer_that_comes_late_will_get_keeps_nothing_else_in_memory() -> None:
    session = synthetic_night(FRAMES)
    rows = near_rows(session.frames.columns[:], session.station.limits, 3)
    assert len(rows) == 3
    assert rows.base is None


def test_the_items_of_housekeeping_are_drawn_in_a_graph_of_their_unit(tmp_path: Path) -> None:
    session = synthetic_night(20)
    session.housekeeping = Housekeeping(ITEMS.items)
    items = np.zeros(6, ITEM)
    items["utc_ns"] = int(session.frames.columns["utc_ns"][0]) + np.repeat([0, NS_PER_S], 3)
    items["item"] = np.tile([list(ITEMS.items).index(name) for name in ("supply_v", "detector_degc", "mode")], 2)
    items["value"] = [5.0, 20.5, 1, 5.25, 21.5, 2]
    session.housekeeping.extend(items)
    path = tmp_path / "night.rrd"
    save_view(session, small_catalog(), path, "PASS", [])
    found = rows_of(path)
    assert values(found, "/housekeeping/0/supply_v").ravel().tolist() == [5.0, 5.25]
    assert values(found, "/housekeeping/1/detector_degc").ravel().tolist() == [20.5, 21.5]
    assert [row["utc"] for row in moving(found["/housekeeping/0/supply_v"])] == items["utc_ns"][::3].tolist()
    assert not [name for name in found if "mode" in name]


def test_the_items_of_a_running_session_are_drawn_once_a_second_and_come_late_too(tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    session = synthetic_night(20)
    housekeeping, start_ns = Housekeeping(ITEMS.items), int(session.frames.columns["utc_ns"][0])
    numbers = [list(ITEMS.items).index(name) for name in ("supply_v", "detector_degc", "mode")]
    stream = rerun.RecordingStream("gse", send_properties=False)
    stream.save(str(path))
    scene = Scene(stream, session.station, None, live=True)
    for second in range(3):
        rows = np.zeros(6, ITEM)
        rows["utc_ns"] = start_ns + second * NS_PER_S + np.repeat([0, NS_PER_S // 2], 3)
        rows["item"], rows["value"] = np.tile(numbers, 2), [0.0, 0.0, 1.0, 5.0 + second, 20.5, 1.0]
        housekeeping.extend(rows)
        scene.add_latest_items(housekeeping)
        scene.add_latest_items(housekeeping)  # nothing new came
        if second == 1:
            first = scene.piece_after("")
    pieces = {"first": first.rrd, "next": scene.piece_after(first.place).rrd}
    for name, piece in pieces.items():
        (tmp_path / f"{name}.rrd").write_bytes(piece)
    stream.flush()
    stream.disconnect()
    whole, early, late = (rows_of(one) for one in (path, tmp_path / "first.rrd", tmp_path / "next.rrd"))
    drawn = [values(of, "/housekeeping/0/supply_v").ravel().tolist() for of in (whole, early, late)]
    assert drawn == [[5.0, 6.0, 7.0], [5.0, 6.0], [7.0]]
    assert [row["static"] for row in early["/housekeeping/1/detector_degc"]] == [False, False, True]
    assert not [name for name in whole if "mode" in name]

"""Pages and figures of reports: content, numbers, names from files as letters, and how
a browser shows them.
"""

import base64
import csv
import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from chromium import in_chromium
from foreign_files import with_log
from matplotlib.figure import Figure
from page_markup import Markup
from playwright.sync_api import Browser, Page
from small_recordings import (
    calibration_of_a_sealed_eye,
    changed,
    evaluation_of,
    frame_answer,
    looked_at_frames,
    read_frames,
    refused_frame,
    write_small_recording,
)

import scleraforce as sf
from figures.studies.conjunctiva import SCALE, drawn
from scleraforce.base.errors import InputError
from scleraforce.base.version import __version__
from scleraforce.calibration.evaluation import Evaluation, FrameAnswer
from scleraforce.front.report.described_paths import thing_at
from scleraforce.front.report.figure_files import encode_figure, write_figure
from scleraforce.front.report.figures_beside import figure_encoder
from scleraforce.front.report.frame_figures import (
    MOST,
    WORST,
    AnsweredFrame,
    answered_frames,
    draw_residuals,
    laid_on_surface,
    shown_on_sheet,
)
from scleraforce.front.report.html_pages import (
    PageTable,
    shown_frames,
    write_evaluation_html,
    write_page,
)
from scleraforce.front.report.model_figures import draw_curves, draw_model, draw_network
from scleraforce.front.report.recording_figures import (
    draw_calibration,
    draw_force_log,
    draw_recording,
)
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.recordings.forces_under_frames import Trial
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.model_folder import (
    LIBRARY_FILE,
    SHIPPED_READER,
)
from scleraforce.records.remark import Remark
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import draw_overlay

MADE_AT = datetime(2026, 3, 1, 0, 30, tzinfo=UTC)
NOTHING = "\N{EN DASH}"


def answers() -> Evaluation:
    """Six frames of two eyes: one misread, one not usable, one over the largest force,
    one used for calibration.
    """
    a = {"recording": "rec/a", "eye": "eye a"}
    b = {"recording": "rec/b", "eye": "eye <b>"}
    withdraw = {"target": 2, "predicted": 2, "probabilities": (0.0, 0.0, 1.0)}
    harmless = {"target": 0, "predicted": 0, "probabilities": (0.9, 0.1, 0.0)}
    unseen = {"target": 2, "reason": "no wall found", "measured_force_n": 0.040}
    frames = (
        frame_answer(**a, measured_force_n=0.002, **harmless),
        frame_answer(**a, file="0001.png", predicted=2, probabilities=(0.0, 0.4, 0.6)),
        refused_frame(**a, file="0002.png", **unseen),
        frame_answer(**b, measured_force_n=0.050, **withdraw),
        frame_answer(
            **b,
            file="0001.png",
            measured_force_n=0.080,
            **withdraw,
            excluded="above 60 mN",
        ),
        frame_answer(**b, file="0002.png", measured_force_n=0.010, calibration=True),
    )

    gap = Remark("outside-training", "the gap is another", ("gap_m",))
    return evaluation_of(frames, model="out/model", remarks=(gap,))


def write_and_read(
    folder: Path, evaluation: Evaluation, looks: Sequence[AnsweredFrame] = ()
) -> str:
    (folder / "page.html").unlink(missing_ok=True)
    write_evaluation_html(evaluation, looks, folder / "page.html", MADE_AT)
    return (folder / "page.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Markup:
    return Markup(write_and_read(tmp_path_factory.mktemp("page"), answers()))


def test_a_page_loads_nothing_and_has_its_makers_date_limits_and_images_in_words(
    page: Markup,
) -> None:
    given = [attributes for _, attributes in page.tags]
    sources = [one[key] or "" for one in given for key in ("src", "href") if key in one]
    assert sources
    assert all(one.startswith(("data:image/", "data:text/csv")) for one in sources)
    assert not {"script", "link", "iframe"} & {tag for tag, _ in page.tags}
    assert all(attributes.get("alt") for tag, attributes in page.tags if tag == "img")
    assert f"scleraforce {__version__}, 2026-03-01 00:30 UTC" in page.said
    assert "not a medical device" in page.said
    assert "caution the gap is another" in " ".join(page.said.split())


def test_recordings_without_labels_have_no_metrics_and_still_a_page(
    tmp_path: Path,
) -> None:
    unlabelled = evaluation_of(
        replace(frame, measured_force_n=None, target=None) for frame in answers().frames
    )
    page = Markup(write_and_read(tmp_path, unlabelled))
    assert "No frame has a label that counts" in page.said
    assert len([row for row in page.cells if row and row[0].endswith(".png")]) == 6


def test_an_existing_page_is_kept_unless_it_may_be_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text("mine")
    for place, words in ((path, "exists already"), (tmp_path / "no" / "a", "No such")):
        with pytest.raises(InputError, match=words):
            write_evaluation_html(answers(), (), place, MADE_AT)

    assert path.read_text() == "mine"
    write_page("front/report/page.html", path, MADE_AT, {}, overwrite=True)
    assert path.read_text().startswith("<!DOCTYPE html>")
    assert list(tmp_path.iterdir()) == [path]


# Elements that reach beyond the window or that hide a part of their content; wide
# figures are moved sideways.
CUT = """() => [...document.querySelectorAll("body :not(.wide, .wide *)")].filter((element) => {
  const box = element.getBoundingClientRect();
  return box.right > document.documentElement.clientWidth + 0.5 || element.scrollWidth > element.clientWidth + 1
    && getComputedStyle(element).overflowX !== "visible";
}).map((element) => element.outerHTML.slice(0, 80))"""


@pytest.fixture(scope="module")
def wide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a reader's evaluation with every column, a long remark, a long name
    and pictures.
    """
    folder = tmp_path_factory.mktemp("page")
    reason = "the dent leaves the window of the slice, by 23 mN in words of some length"
    name = "a-recording-with-a-name-as-long-as-they-are" * 2
    looks, evaluation = read_frames(folder / name, reason, modulus_source="population")
    write_evaluation_html(evaluation, looks, folder / "page.html", MADE_AT)
    return folder / "page.html"


@in_chromium
@pytest.mark.parametrize("width", [360, 760, 761, 1300, "A4"])
def test_nothing_is_cut_at_any_width_or_on_paper(
    browser: Browser, wide: Path, width: int | str
) -> None:
    pixels = 680 if isinstance(width, str) else width  # between margins of 15 mm
    page: Page = browser.new_page(viewport={"width": pixels, "height": 900})
    page.goto(wide.as_uri())
    if width == "A4":
        page.emulate_media(media="print")
    assert page.evaluate("document.documentElement.scrollWidth") <= pixels
    assert page.evaluate(CUT) == []
    page.close()


def test_an_evaluation_carries_the_wall_that_was_read_below_a_conjunctiva(
    tmp_path: Path,
) -> None:
    bscan, thickness_m = drawn(140, 1)
    (tmp_path / "frames").mkdir()
    cv2.imwrite(str(tmp_path / "frames" / "1.png"), bscan.frame)
    (tmp_path / "frames.csv").write_text("file,time_s\n1.png,0\n")
    (tmp_path / "recording.toml").write_text(
        f'[eye]\nid = "eye"\nthickness_m = {thickness_m}\n[oct]\ncolumns = 512\nrows ='
        " 512\nbits = 12\nwidth_m = 15e-3\ndepth_m = 4e-3\n[needle]\ngauge ="
        " 22\nslice_gap_m = 5e-4\n"
    )
    (shown,) = answered_frames(sf.evaluate("default", tmp_path).frames)
    layer = find_wall(bscan.frame, SCALE)
    assert np.nanmean(shown.found.outer_row - layer.outer_row) > 8.0


def many(count: int, misread: Sequence[int] = ()) -> tuple[FrameAnswer, ...]:
    return tuple(
        frame_answer(file=f"{n:04d}.png", predicted=2 if n in misread else 1)
        for n in range(count)
    )


def test_misread_frames_are_shown_first_and_others_in_even_steps() -> None:
    few = many(12)
    assert shown_frames(few) == few
    misread = {3, 4, 997}
    numbers = [int(one.file[:4]) for one in shown_frames(many(1001, [*misread]))]
    assert numbers == sorted(numbers)
    assert misread < {*numbers}
    assert np.diff([number for number in numbers if number not in misread]).min() > 20
    assert len(shown_frames(many(500, misread=range(400)))) == len(numbers)


def test_a_picture_is_to_scale_and_has_surface_and_inner_boundary_where_they_were_found(
    tmp_path: Path,
) -> None:
    (look,) = looked_at_frames(tmp_path, 1)
    files = files_of(write_and_read(tmp_path, evaluation_of([look.answer]), [look]))
    content = files[f"{look.answer.file}.jpg"]
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    rows, columns = picture.shape[:2]
    width_m, depth_m = look.extent_m
    assert abs(rows / columns - depth_m / width_m) < 0.5 / columns
    blue, _, red = picture[:, columns // 2].astype(int).T
    middle = look.frame.shape[1] // 2
    for drawn_as, boundary in (
        (red - blue, look.found.outer_row),
        (blue - red, look.found.inner_row),
    ):
        row = (boundary[middle] + 0.5) * rows / len(look.frame)
        assert abs(int(np.argmax(drawn_as)) - row) < 2.0


def test_an_inner_boundary_that_is_not_seen_is_dashed(tmp_path: Path) -> None:
    (look,) = looked_at_frames(tmp_path, 1)
    columns = []
    for seen in (True, False):
        found = replace(look.found, inner_found=seen)
        blue, _, red = np.moveaxis(
            draw_overlay(np.zeros_like(look.frame), found).astype(int), -1, 0
        )
        columns.append(np.count_nonzero((blue > red + 140).any(axis=0)))
    assert columns[1] == pytest.approx(columns[0] / 2, rel=0.1)


def test_below_a_picture_are_the_measured_and_the_read_force_and_misread_ones_are_marked(
    tmp_path: Path,
) -> None:
    looks = looked_at_frames(tmp_path, 3)
    unseen = {"usable": False, "reason": "no wall found", "probabilities": None}
    said = (
        {"predicted": 2, "force_n": 0.031, "interval_n": (0.029, 0.033)},
        {**unseen, "predicted": 2, "target": 2},
        {"measured_force_n": None, "target": None, "predicted": 0},
    )
    looks = [
        replace(look, answer=changed(look.answer, **each))
        for look, each in zip(looks, said, strict=True)
    ]
    answered = evaluation_of(look.answer for look in looks)
    html = write_and_read(tmp_path, answered, looks)
    assert html.count('<figure class="marked">') == 1
    assert "measured 20.0 mN (class 1); read 31.0 mN (29.0 to 33.0; class 2)" in html
    assert "not usable: no wall found" in html
    assert "not measured; read class 0" in html


NAMES = [
    "<!--<script>.png",
    "<img src=x onerror=boom()>.png",
    "$^{$.png",
    "&lt;b&gt;.png",
]
EYE = "<!--<script>boom()</script>"


@pytest.fixture
def hostile(tmp_path: Path, shell) -> Path:
    """The page of a recording whose frames and eye have such names."""
    folder = tmp_path / "<r>"
    looked_at_frames(folder, len(NAMES))
    frames = sorted((folder / "frames").iterdir())
    for frame, name in zip(frames, NAMES, strict=True):
        frame.rename(frame.with_name(name))

    lines = ["file,time_s", *(f"{name},{nth}" for nth, name in enumerate(NAMES))]
    (folder / "frames.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    info = folder / "recording.toml"
    info.write_text(info.read_text().replace('id = "eye"', f"id = '{EYE}'"))
    shell.run("evaluate default", folder, "--html", tmp_path / "evaluate.html")
    return tmp_path / "evaluate.html"


def test_no_name_is_markup_on_a_page_or_a_formula_in_a_picture(
    hostile: Path, shell
) -> None:
    source = hostile.read_text(encoding="utf-8")
    found = Markup(source)
    assert all(name in found.said for name in (EYE, *NAMES))
    attributes = {name for _, given in found.tags for name in given}
    assert not any(name.startswith("on") for name in attributes)
    assert not re.search(r"<!--(?!\[)", source)
    assert "script" not in [tag for tag, _ in found.tags]
    plot = hostile.with_name("r.svg")
    shell.run("show", hostile.with_name("<r>"), "--plot", plot)
    assert plot.stat().st_size > 0


@in_chromium
def test_a_browser_shows_the_names_and_runs_none(
    hostile: Path, browser: Browser
) -> None:
    page = browser.new_context(offline=True).new_page()
    faults: list[str] = []
    page.on("pageerror", lambda fault: faults.append(str(fault)))
    page.goto(hostile.as_uri())
    shown = page.locator("body").inner_text()
    assert all(name in shown for name in (EYE, *NAMES))
    assert faults == []


def test_no_script_of_a_page_makes_markup_of_texts() -> None:
    scripts = [*Path(sf.__file__).parent.rglob("*.js")]
    assert scripts
    sinks = r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\("
    for script in scripts:
        assert not re.search(sinks, script.read_text("utf-8")), script


def read_evaluation() -> Evaluation:
    """Three trials with labels of 1 mN: read 2 mN too high, misread 3 mN too low, and
    not usable.
    """
    high = {"force_n": 0.012, "interval_n": (0.009, 0.016), "measured_force_n": 0.010}
    low = {"force_n": 0.037, "interval_n": (0.035, 0.041), "measured_force_n": 0.040}
    frames = [
        frame_answer(file="0.png", measured_force_sd_n=0.001, **high),
        frame_answer(
            file="1.png", measured_force_sd_n=0.001, **low, predicted=1, target=2
        ),
        refused_frame(file="2.png", measured_force_n=0.050, target=2),
    ]
    return evaluation_of(frames, kind="reader")


def test_residuals_are_read_minus_measured_forces_with_their_intervals_and_limits_of_agreement():
    (axes,) = draw_residuals(read_evaluation()).axes
    lines = {line.get_label(): np.column_stack(line.get_data()) for line in axes.lines}
    np.testing.assert_allclose(lines["read as class 1"], [[10.0, 2.0], [40.0, -3.0]])
    np.testing.assert_allclose(lines["misread"], [[40.0, -3.0]])
    assert lines["not usable"][:, 0].tolist() == [50.0]
    intervals = [part for entry in axes.collections for part in entry.get_segments()]
    ends = [[[10.0, -1.0], [10.0, 6.0]], [[40.0, -5.0], [40.0, 1.0]]]
    np.testing.assert_allclose(intervals, ends)
    reach = 1.959964 * np.std([2.0, -3.0], ddof=1)
    dashed = {
        line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == "--"
    }
    assert {*np.round([-0.5 - reach, -0.5 + reach], 4)} < {*np.round([*dashed], 4)}
    np.testing.assert_allclose(lines["mean \N{MINUS SIGN}0.50 mN"][:, 1], -0.5)


def files_of(source: str) -> dict[str, bytes]:
    """The files that a page saves, by name."""
    found = re.findall(r'download="([^"]*)" href="data:[^"]*;base64,([^"]*)"', source)
    assert len({name for name, _ in found}) == len(found) == source.count("download=")
    return {name: base64.b64decode(content) for name, content in found}


def test_a_page_saves_its_figures_frames_and_tables(tmp_path: Path) -> None:
    looks, evaluation = read_frames(tmp_path / "eye", "no wall")
    source = write_and_read(tmp_path, evaluation, looks)
    files = files_of(source)
    frames = [f"{look.answer.file}.jpg" for look in looks]
    assert [*files] == ["confusion.csv", "residuals.svg", *frames, "frames.csv"]
    shown = re.findall(r'src="data:[^"]*;base64,([^"]*)"', source)
    saved = [files[name] for name in ("residuals.svg", *frames)]
    assert [base64.b64decode(each) for each in shown] == saved
    rows = list(csv.DictReader(StringIO(files["frames.csv"].decode())))
    assert [row["file"] for row in rows] == [look.answer.file for look in looks]
    assert [row["predicted_force_mn"] for row in rows] == ["21.0", "21.0", "", "21.0"]
    confusion = list(csv.reader(StringIO(files["confusion.csv"].decode())))
    assert confusion[2][1:] == ["0", "2", "2", "0.50 (0.15 to 0.85)"]


def test_a_saved_table_has_numbers_texts_and_empty_cells() -> None:
    between = f"2 {NOTHING} 3"
    spread = "1.0\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}0.2"
    row = ["=2", 3, "+1.5", "-0.40", NOTHING, between, spread]
    _, content = PageTable("abcdefg", [row]).csv.split(";base64,")
    line = base64.b64decode(content).decode().splitlines()[1]
    assert line == f"'=2,3,1.5,-0.4,,{between},1.0 ± 0.2"


@in_chromium
def test_a_browser_saves_a_figure_and_a_table_without_a_network(
    browser: Browser, wide: Path
) -> None:
    page = browser.new_context(offline=True).new_page()
    page.goto(wide.as_uri())
    files = files_of(wide.read_text(encoding="utf-8"))
    for name in ("residuals.svg", "frames.csv"):
        with page.expect_download() as download:
            page.click(f'a[download="{name}"]')
        assert Path(download.value.path()).read_bytes() == files[name]

    page.close()


@in_chromium
def test_a_figure_has_as_much_ink_in_dark_mode_as_in_light(
    browser: Browser, logged: Recording, tmp_path: Path
) -> None:
    figures = [
        draw_model(sf.Study()),
        draw_network((140, 40), (600, 600), ("class 0", "class 1", "class 2"), 0.5),
        draw_curves({"training_loss": (1.0, 0.5)}, "epoch"),
        draw_calibration(calibration_of_a_sealed_eye()),
        draw_recording(logged),
        thing_at(SHIPPED_READER / LIBRARY_FILE).draw(),
    ]
    pictures = [tmp_path / f"{number}.svg" for number in range(len(figures))]
    for figure, path in zip(figures, pictures, strict=True):
        write_figure(figure, path)
    for evaluation in (read_evaluation(), answers()):
        for name, content in files_of(write_and_read(tmp_path, evaluation)).items():
            if name.endswith(".svg"):
                pictures.append(tmp_path / name)
                pictures[-1].write_bytes(content)

    assert len(pictures) == len(figures) + 2
    html = tmp_path / "figure.html"
    for path in pictures:
        html.write_text(
            f'<html style="color-scheme: light dark"><img width="700" src="{path}">'
        )
        inked = []
        for scheme in ("light", "dark"):
            page = browser.new_page(
                viewport={"width": 700, "height": 500}, color_scheme=scheme
            )
            page.goto(html.as_uri())
            content = np.frombuffer(page.locator("img").screenshot(), np.uint8)
            page.close()
            shown = cv2.imdecode(content, cv2.IMREAD_GRAYSCALE)
            paper = np.bincount(shown.ravel()).argmax()
            inked.append(np.count_nonzero(np.abs(shown.astype(int) - paper) > 12))
            assert (paper < 60) == (scheme == "dark")

        assert inked[1] > 0.6 * inked[0], path.name


WIDTH_M = 15e-3
COLUMNS = 512
LATERAL_M = (np.arange(COLUMNS) + 0.5) * WIDTH_M / COLUMNS


def dented(lateral_m: np.ndarray) -> np.ndarray:
    """Depth of an eye with a dent at 0, m."""
    sphere_m = 12e-3 - np.sqrt((12e-3) ** 2 - lateral_m**2)
    return sphere_m + 1.5e-3 * np.exp(-((lateral_m / 1.5e-3) ** 2))


@pytest.mark.parametrize(
    ("shift_m", "down_m"), [(0.0, 0.4e-3), (0.25e-3, 0.9e-3), (-0.4e-3, 0.1e-3)]
)
def test_a_wall_is_laid_on_the_surface_though_a_third_of_it_is_unseen_or_in_the_middle(
    shift_m: float, down_m: float
) -> None:
    lateral_m = np.linspace(-9e-3, 9e-3, 400)
    outer = np.stack([lateral_m, dented(lateral_m)], axis=1)
    wall = WallSection(outer, outer + np.array([0.0, 0.5e-3]))
    surface_m = dented(LATERAL_M - WIDTH_M / 2 - shift_m) + down_m
    surface_m[100:270] = np.nan
    surface_m[300:310] += 1e-3  # a wrong stretch
    laid = laid_on_surface(wall, surface_m, WIDTH_M)
    moved = laid.outer[0] - outer[0] - [WIDTH_M / 2, 0.0]
    # half a step of the shifts
    assert moved == pytest.approx([shift_m, down_m], abs=13e-6)
    assert laid.inner - laid.outer == pytest.approx(wall.inner - wall.outer)
    laid = laid_on_surface(wall, np.full(COLUMNS, np.nan), WIDTH_M)
    assert laid.outer == pytest.approx(outer + np.array([WIDTH_M / 2, 0.0]))


@pytest.fixture
def logged(tmp_path: Path) -> Recording:
    """A recording whose sensor has a zero of 50 mN."""
    folder = with_log(write_small_recording(tmp_path / "r", frames=12))
    recording = sf.read_recording(folder)
    log = recording.forces
    assert log is not None
    return replace(recording, forces=replace(log, wrench_sc=log.wrench_sc + 0.05))


def test_a_force_log_is_drawn_in_millinewtons_with_the_times_of_all_frames_and_labels_by_class(
    logged: Recording,
) -> None:
    labels = ((1.0, 0.04, 2), (1.05, None, None), (1.1, 0.01, 1))
    trials = [
        Trial(file="a.png", time_s=at, measured_force_n=force, target=target)
        for at, force, target in labels
    ]
    (axes,) = draw_force_log(logged, trials, (), 2.0).axes
    raw, filtered, first, second = axes.lines
    off = raw.get_ydata() + 1e3 * logged.forces.force_n("fz")  # contact_sign is -1
    np.testing.assert_allclose(off, off[0])
    assert np.mean(raw.get_ydata()) == pytest.approx(np.mean(filtered.get_ydata()))
    assert filtered.get_ydata().max() == pytest.approx(10.0, abs=0.5)
    marks = [segment[0][0] for segment in axes.collections[0].get_segments()]
    assert marks == pytest.approx([frame.time_s for frame in logged.frames])
    points = [np.column_stack(line.get_data()).tolist() for line in (first, second)]
    assert points == [[[1.1, 10.0]], [[1.0, 40.0]]]


@pytest.mark.parametrize(
    ("ending", "start"),
    [
        (".png", b"\x89PNG"),
        (".svg", b"<?xml"),
        pytest.param(".PDF", b"%PDF", marks=pytest.mark.slow),
    ],
)
def test_a_figure_has_the_format_of_its_name_and_the_same_bytes_each_time(
    tmp_path: Path, ending: str, start: bytes
) -> None:
    contents = set()
    for name in ("one", "two"):
        figure = Figure()
        figure.subplots().plot([0, 1], [1, 0], label="line")
        figure.suptitle("検査")  # the font lacks these: without a warning
        write_figure(figure, tmp_path / f"{name}{ending}")
        contents.add((tmp_path / f"{name}{ending}").read_bytes())

    (content,) = contents
    assert content.startswith(start)
    with pytest.raises(InputError, match=r"a\.xlsx.*\.png, \.svg, \.pdf"):
        write_figure(Figure(), tmp_path / "a.xlsx")
    assert len(list(tmp_path.iterdir())) == 2


def test_a_sheet_shows_the_worst_frames_and_others_in_even_steps() -> None:
    badness = [(number == 7, float(number)) for number in range(2000)]
    shown = shown_on_sheet(badness)
    assert shown[:WORST] == [7, *range(1999, 2000 - WORST, -1)]
    assert len(shown) == MOST
    assert np.ptp(np.diff(shown[WORST:])) <= 2  # in even steps, but for number 7
    assert shown_on_sheet(badness[:5]) == [4, 3, 2, 1, 0]


@pytest.mark.slow
def test_a_readers_page_has_forces_intervals_and_the_moduli_of_the_eyes(
    tmp_path: Path,
):
    first, misread, *others = answers().frames
    differ = (Remark("methods-disagree", "they differ"),)
    read = [
        changed(first, force_n=0.0021, interval_n=(0.001, 0.004), remarks=differ),
        changed(misread, force_n=0.031, interval_n=(0.029, 0.033), remarks=differ),
    ]
    moduli = {
        "eye a": {"youngs_modulus_pa": 0.27e6, "modulus_source": "own"},
        "eye <b>": {"youngs_modulus_pa": 0.25e6, "modulus_source": "population"},
    }
    frames = tuple(changed(one, **moduli[one.eye]) for one in (*read, *others))
    found = replace(answers(), kind="reader", frames=frames)
    page = Markup(write_and_read(tmp_path, found))
    assert "29.0 to 33.0" in page.said.replace("\N{NO-BREAK SPACE}", " ")
    assert "they differ" in page.said
    assert "eye a: 0.27 MPa (calibrated), eye <b>: 0.25 MPa (mean of" in page.said
    assert "5.55 mN" in page.said  # (0.1 + 11) / 2
    assert "1 of 2 trials" in page.said


def test_figures_of_a_page_are_encoded_beside_as_they_are_here() -> None:
    line = Figure()
    line.subplots().plot([0.0, 1.0])
    picture = Figure()
    picture.subplots().imshow(np.eye(3))
    with figure_encoder() as encoder:
        begun = encoder.begin([(line, 0.5), "words", picture])
        found = encoder.finish(begun)

    expected = [(encode_figure(line), 0.5), "words", encode_figure(picture)]
    assert found == expected
    assert [bool(one.png) for one in (found[0][0], found[2])] == [False, True]

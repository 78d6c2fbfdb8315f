"""Pages and figures of reports: content, numbers, names from files as letters, and how
a browser shows them.
"""

import base64
import csv
import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from chromium import in_chromium
from foreign_files import with_log
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
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

import scleraforce
from bench_conjunctiva import SCALE, STUDY, drawn
from scleraforce import __version__
from scleraforce.base.errors import InputError
from scleraforce.calibration.answer_metrics import dice
from scleraforce.calibration.evaluation import (
    Evaluation,
    FrameAnswer,
    evaluate_recordings,
)
from scleraforce.front.api.reading_frames import finder_of, segmented_frame
from scleraforce.front.cli.main import run
from scleraforce.front.report.described_artefacts import draw_library
from scleraforce.front.report.figure_files import (
    BLACK,
    DARK,
    LIGHT,
    PAPER,
    SHADE,
    svg_uri,
    write_figure,
)
from scleraforce.front.report.frame_figures import (
    MOST,
    WALLS,
    WORST,
    AnsweredFrame,
    answered_frames,
    draw_residuals,
    draw_sheet,
    draw_trial_forces,
    laid_on_surface,
    sheet_frame,
    shown_on_sheet,
)
from scleraforce.front.report.html_pages import (
    MOST_PICTURES,
    PageTable,
    shown_frames,
    write_evaluation_html,
    write_page,
)
from scleraforce.front.report.model_figures import draw_curves, draw_model, draw_network
from scleraforce.front.report.recording_figures import (
    draw_calibration,
    draw_log,
    draw_recording,
)
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.reading.frame_checks import segment_and_slice
from scleraforce.reading.load_model import load_force_reader, load_reader
from scleraforce.recordings.forces_under_frames import Trial
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.model_folder import SHIPPED_READER, SHIPPED_WALL_FINDER
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Scan
from scleraforce.records.study import Study
from scleraforce.wall.wall import INNER, draw_overlay

MADE_AT = datetime(2026, 3, 1, 0, 30, tzinfo=UTC)


def answers() -> Evaluation:
    """Six frames of two eyes: one misread, one not usable, one over the largest force,
    one used for calibration.
    """
    a = {"recording": "rec/a", "eye": "eye a"}
    b = {"recording": "rec/b", "eye": "eye <b>"}
    withdraw = {"target": 2, "predicted": 2, "probabilities": (0.0, 0.0, 1.0)}
    frames = (
        frame_answer(
            **a,
            measured_force_n=0.002,
            target=0,
            predicted=0,
            probabilities=(0.9, 0.1, 0.0),
        ),
        frame_answer(**a, file="0001.png", predicted=2, probabilities=(0.0, 0.4, 0.6)),
        refused_frame(
            **a,
            file="0002.png",
            measured_force_n=0.040,
            target=2,
            reason="no wall found",
        ),
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


class Markup(HTMLParser):
    """Collects the tags and the text of a page; asserts that every tag is closed."""

    VOID = frozenset({"meta", "img", "br"})

    def __init__(self, source: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.cells: list[list[str]] = []
        self.said = ""
        self.feed(source)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "tr":
            self.cells.append([])
        if tag in ("td", "th"):
            self.cells[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.said += data
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1][-1] += data


def write_and_read(
    folder: Path, evaluation: Evaluation, looks: Sequence[AnsweredFrame] = ()
) -> str:
    (folder / "page.html").unlink(missing_ok=True)
    write_evaluation_html(evaluation, looks, folder / "page.html", MADE_AT)
    return (folder / "page.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_and_read(tmp_path_factory.mktemp("page"), answers())


@pytest.fixture
def page(source: str) -> Markup:
    return Markup(source)


def test_a_page_loads_nothing_and_has_its_makers_date_limits_and_images_in_words(
    page: Markup,
) -> None:
    sources = [
        attributes[key]
        for _, attributes in page.tags
        for key in ("src", "href")
        if key in attributes
    ]
    assert sources
    assert all(
        (source or "").startswith(("data:image/", "data:text/csv"))
        for source in sources
    )
    assert not any(tag in ("script", "link", "iframe") for tag, _ in page.tags)
    assert all(attributes.get("alt") for tag, attributes in page.tags if tag == "img")
    assert (
        f"scleraforce {__version__}, 2026-03-01 00:30 UTC. Research use only: not a"
        " medical device." in page.said
    )
    assert "caution the gap is another" in " ".join(page.said.split())


def test_the_confusion_matrix_has_targets_in_rows_and_counts_scored_trials_only(
    page: Markup,
) -> None:
    rows = [row for row in page.cells if row and row[0].startswith("target class")]
    assert [row[1:4] for row in rows] == [
        ["1", "0", "0"],
        ["0", "0", "1"],
        ["0", "0", "2"],
    ]
    assert [row[4][:4] for row in rows] == ["1.00", "0.00", "1.00"]
    precision = next(row for row in page.cells if row and row[0] == "precision")
    assert precision[1].startswith("1.00")
    assert precision[2] == "\N{EN DASH}"
    assert precision[3].startswith("0.67")


def test_every_frame_is_listed_with_its_remark_and_usable_ones_with_probabilities(
    page: Markup,
) -> None:
    rows = {row[1]: row for row in page.cells if row and row[0].endswith(".png")}
    assert len(rows) == 6
    assert rows["40.0"][-1] == "not usable (no wall found)"
    assert rows["80.0"][-1] == "not counted: above 60 mN"
    assert rows["10.0"][-1] == "Young's modulus was fitted on it: not counted"
    assert rows["20.0"][2:4] == ["1", "2"]
    assert np.allclose([float(cell) for cell in rows["20.0"][4:7]], [0.0, 0.4, 0.6])
    assert rows["40.0"][4:7] == ["\N{EN DASH}"] * 3


def test_recordings_without_labels_have_no_metrics_and_still_a_page(
    tmp_path: Path,
) -> None:
    unlabelled = tuple(
        replace(f, measured_force_n=None, target=None) for f in answers().frames
    )
    page = Markup(
        write_and_read(tmp_path, replace(answers(), frames=unlabelled, remarks=()))
    )
    assert "No frame has a label that counts" in page.said
    assert len([row for row in page.cells if row and row[0].endswith(".png")]) == 6


def test_an_existing_page_is_kept_unless_it_may_be_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_evaluation_html(answers(), (), path, MADE_AT)

    assert path.read_text() == "mine"
    write_page("front/report/page.html", path, MADE_AT, {}, overwrite=True)
    assert path.read_text().startswith("<!DOCTYPE html>")
    assert list(tmp_path.iterdir()) == [path]

    with pytest.raises(InputError, match=r"no/page\.html: No such file or directory"):
        write_evaluation_html(answers(), (), tmp_path / "no" / "page.html", MADE_AT)


@pytest.mark.slow
def test_a_readers_page_has_forces_intervals_and_the_moduli_of_the_eyes(
    tmp_path: Path,
) -> None:
    read = {"0000.png": (0.0021, (0.001, 0.004)), "0001.png": (0.031, (0.029, 0.033))}
    moduli = {"eye a": (0.27e6, "own"), "eye <b>": (0.25e6, "population")}
    frames = []

    for frame in answers().frames:
        modulus_pa, source = moduli[frame.eye]
        force_n, interval_n = (
            read.get(frame.file, (None, None))
            if frame.recording == "rec/a"
            else (None, None)
        )
        warnings = ("they differ",) if force_n else ()
        said = {"force_n": force_n, "interval_n": interval_n, "warnings": warnings}
        frames.append(
            changed(frame, youngs_modulus_pa=modulus_pa, modulus_source=source, **said)
        )

    page = Markup(
        write_and_read(
            tmp_path, replace(answers(), kind="reader", frames=tuple(frames))
        )
    )
    rows = {row[1]: row for row in page.cells if row and row[0].endswith(".png")}
    assert [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in rows["20.0"][4:6]] == [
        "31.0",
        "29.0 to 33.0",
    ]
    assert rows["40.0"][4:6] == ["\N{EN DASH}"] * 2
    assert rows["20.0"][-1] == "they differ"
    assert (
        "eye a: 0.27 MPa (calibrated), eye <b>: 0.25 MPa (mean of the calibrated eyes)"
        in page.said
    )
    assert "5.55 mN" in page.said  # (0.1 + 11) / 2
    assert "1 of 2 trials" in page.said
    assert any(
        "over its measured force" in (attributes.get("alt") or "")
        for _, attributes in page.tags
    )


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
    reason = (
        "the dent leaves the window of the slice, and its flanks leave the force"
        " uncertain by 23 mN"
    )
    name = "a-recording-with-a-name-as-long-as-they-are" * 2
    looks, evaluation = read_frames(folder / name, reason, modulus_source="population")
    write_evaluation_html(
        evaluation, looks, folder / "page.html", datetime(2026, 3, 1, tzinfo=UTC)
    )

    return folder / "page.html"


def opened_at(browser: Browser, path: Path, width: int, scheme: str = "light") -> Page:
    page = browser.new_page(
        viewport={"width": width, "height": 900}, color_scheme=scheme
    )
    page.goto(path.as_uri())
    return page


@in_chromium
def test_nothing_is_cut_at_any_width_or_on_paper(browser: Browser, wide: Path) -> None:
    for width in (360, 400, 760, 761, 1300):
        page = opened_at(browser, wide, width)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(CUT) == [], width
        page.close()

    page = opened_at(browser, wide, 680)  # A4 between margins of 15 mm
    page.emulate_media(media="print")
    assert page.evaluate(CUT) == []
    page.close()


def recording_under_a_conjunctiva(folder: Path) -> tuple[np.ndarray, float]:
    """Write a recording of one frame; return the frame and the wall's thickness, which
    the recording states.
    """
    bscan, thickness_m = drawn(140, 1)
    (folder / "frames").mkdir(parents=True)
    cv2.imwrite(str(folder / "frames" / "1.png"), bscan.frame)
    (folder / "frames.csv").write_text("file,time_s\n1.png,0\n")
    (folder / "recording.toml").write_text(
        f'[eye]\nid = "eye"\nthickness_m = {thickness_m}\n[oct]\ncolumns = 512\nrows ='
        " 512\nbits = 12\nwidth_m = 15e-3\ndepth_m = 4e-3\n[needle]\ngauge ="
        " 22\nslice_gap_m = 5e-4\n"
    )

    return bscan.frame, thickness_m


def test_an_evaluation_carries_the_wall_that_was_read_below_a_conjunctiva(
    tmp_path: Path,
) -> None:
    frame, thickness_m = recording_under_a_conjunctiva(tmp_path)
    evaluation = evaluate_recordings(load_reader(SHIPPED_READER), [tmp_path])
    (shown,) = answered_frames(evaluation.frames)
    read, first = (
        segment_and_slice(frame, SCALE, STUDY.slice, thickness_m=stated).segmentation
        for stated in (thickness_m, None)
    )
    np.testing.assert_array_equal(shown.found.outer_row, read.outer_row)
    # it is not the layer's surface
    assert np.nanmean(read.outer_row - first.outer_row) > 8.0


def many(count: int, misread: tuple[int, ...] = ()) -> tuple[FrameAnswer, ...]:
    return tuple(
        frame_answer(file=f"{n:04d}.png", predicted=2 if n in misread else 1)
        for n in range(count)
    )


def pictures(html: str) -> list[np.ndarray]:
    found = re.findall(r'src="data:image/jpeg;base64,([^"]*)"', html)
    return [
        cv2.imdecode(np.frombuffer(base64.b64decode(one), np.uint8), cv2.IMREAD_COLOR)
        for one in found
    ]


def test_misread_frames_are_shown_first_and_others_in_even_steps() -> None:
    few = many(MOST_PICTURES)
    assert shown_frames(few) == few
    frames = many(1001, misread=(3, 4, 997))
    shown = shown_frames(frames)
    assert [frame.file for frame in shown[:3]] == ["0000.png", "0003.png", "0004.png"]
    numbers = [frames.index(frame) for frame in shown]
    assert numbers == sorted(numbers)
    assert len(shown) == MOST_PICTURES
    assert (
        np.diff([number for number in numbers if number not in (3, 4, 997)]).min() > 20
    )
    assert len(shown_frames(many(500, misread=tuple(range(400))))) == MOST_PICTURES


def test_a_picture_is_to_scale_and_has_surface_and_inner_boundary_where_they_were_found(
    tmp_path: Path,
) -> None:
    looks = looked_at_frames(tmp_path, 1)
    (picture,) = pictures(
        write_and_read(tmp_path, evaluation_of([looks[0].answer]), looks)
    )
    rows, columns = picture.shape[:2]
    width_m, depth_m = looks[0].extent_m
    assert abs(rows / columns - depth_m / width_m) < 0.5 / columns
    blue, red = (picture[:, columns // 2, channel].astype(int) for channel in (0, 2))
    scale = rows / len(looks[0].frame)
    middle = looks[0].frame.shape[1] // 2

    for orange_or_blue, boundary in (
        (red - blue, looks[0].found.outer_row),
        (blue - red, looks[0].found.inner_row),
    ):
        assert (
            abs(int(np.argmax(orange_or_blue)) - (boundary[middle] + 0.5) * scale) < 2.0
        )


def test_an_inner_boundary_that_is_not_seen_is_dashed(tmp_path: Path) -> None:
    (one,) = looked_at_frames(tmp_path, 1)
    grey = np.zeros_like(one.frame)
    blues = [
        np.count_nonzero(
            (draw_overlay(grey, replace(one.found, inner_found=seen)) == INNER)
            .all(axis=2)
            .any(axis=0)
        )
        for seen in (True, False)
    ]
    assert blues[1] == pytest.approx(blues[0] / 2, rel=0.1)


def test_below_a_picture_are_the_measured_and_the_read_force_and_misread_ones_are_marked(
    tmp_path: Path,
) -> None:
    looks = looked_at_frames(tmp_path, 3)
    answers = (
        changed(looks[0].answer, predicted=2, force_n=0.031, interval_n=(0.029, 0.033)),
        changed(
            looks[1].answer,
            usable=False,
            reason="no wall found",
            probabilities=None,
            predicted=2,
            target=2,
        ),
        changed(looks[2].answer, measured_force_n=None, target=None, predicted=0),
    )
    looks = [
        replace(look, answer=answer)
        for look, answer in zip(looks, answers, strict=True)
    ]
    html = write_and_read(tmp_path, evaluation_of(answers), looks)
    assert html.count('<figure class="marked">') == 1
    assert "measured 20.0 mN (class 1); read 31.0 mN (29.0 to 33.0; class 2)" in html
    assert "not usable: no wall found" in html
    assert "not measured; read class 0" in html
    assert "All 3 frames are shown." in html
    assert "3 of the 101 frames are shown" in write_and_read(
        tmp_path, evaluation_of([*answers, *many(98)]), looks
    )


ROOT = Path(scleraforce.__file__).parent
NAMES = [
    "<!--<script>.png",
    "<img src=x onerror=boom()>.png",
    "$^{$.png",
    "&lt;b&gt;.png",
]
EYE = "<!--<script>boom()</script>"


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording whose frames and eye have such names, with the page of its readings
    and its picture beside it.
    """
    folder = tmp_path_factory.mktemp("hostile")
    looked_at_frames(folder / "<r>", len(NAMES))
    frames = sorted((folder / "<r>" / "frames").iterdir())
    for frame, name in zip(frames, NAMES, strict=True):
        frame.rename(frame.with_name(name))

    lines = ["file,time_s", *(f"{name},{nth}" for nth, name in enumerate(NAMES))]
    (folder / "<r>" / "frames.csv").write_text(
        "\n".join(lines) + "\n", encoding="utf-8"
    )
    info = folder / "<r>" / "recording.toml"
    info.write_text(info.read_text().replace('id = "eye"', f"id = '{EYE}'"))
    recording = str(folder / "<r>")
    assert (
        run(["evaluate", "default", recording, "--html", str(folder / "evaluate.html")])
        == 0
    )
    assert run(["show", recording, "--plot", str(folder / "r.svg")]) == 0

    return folder


def test_no_name_is_markup_on_a_page_or_a_formula_in_a_picture(hostile: Path) -> None:
    source = (hostile / "evaluate.html").read_text(encoding="utf-8")
    found = Markup(source)
    assert all(name in found.said for name in (EYE, *NAMES))
    assert not any(
        name.startswith("on") for _, attributes in found.tags for name in attributes
    )
    assert not re.search(r"<!--(?!\[)", source)
    assert "script" not in [tag for tag, _ in found.tags]
    assert (hostile / "r.svg").stat().st_size > 0


def test_no_script_of_a_page_makes_markup_of_texts() -> None:
    scripts = [*ROOT.rglob("*.js")]
    assert scripts

    for script in scripts:
        found = re.search(
            r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(",
            script.read_text("utf-8"),
        )
        assert found is None, script


@in_chromium
def test_a_browser_shows_the_names_and_runs_none(
    hostile: Path, browser: Browser
) -> None:
    page = browser.new_context(offline=True).new_page()
    faults: list[str] = []
    page.on("pageerror", lambda fault: faults.append(str(fault)))
    page.goto((hostile / "evaluate.html").as_uri())
    shown = page.locator("body").inner_text()
    assert all(name in shown for name in (EYE, *NAMES))
    assert faults == []


def read_evaluation() -> Evaluation:
    """Three trials with labels of 1 mN: read 2 mN too high, misread 3 mN too low, and
    not usable.
    """
    above = {"force_n": 0.012, "interval_n": (0.009, 0.016)}
    below = {
        "force_n": 0.037,
        "interval_n": (0.035, 0.041),
        "predicted": 1,
        "target": 2,
    }
    frames = [
        frame_answer(
            file="0.png", measured_force_n=0.010, measured_force_sd_n=0.001, **above
        ),
        frame_answer(
            file="1.png", measured_force_n=0.040, measured_force_sd_n=0.001, **below
        ),
        refused_frame(file="2.png", measured_force_n=0.050, target=2),
    ]

    return evaluation_of(frames, kind="reader")


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_residuals_are_read_minus_measured_forces_with_their_intervals_and_limits_of_agreement():
    figure = draw_residuals(read_evaluation())
    (axes,) = figure.axes
    lines = {line.get_label(): np.column_stack(line.get_data()) for line in axes.lines}
    np.testing.assert_allclose(lines["read as class 1"], [[10.0, 2.0], [40.0, -3.0]])
    np.testing.assert_allclose(lines["misread"], [[40.0, -3.0]])
    assert lines["not usable"][:, 0].tolist() == [50.0]
    intervals = [
        segment for entry in axes.collections for segment in entry.get_segments()
    ]
    np.testing.assert_allclose(
        intervals, [[[10.0, -1.0], [10.0, 6.0]], [[40.0, -5.0], [40.0, 1.0]]]
    )
    reach = 1.959964 * np.std([2.0, -3.0], ddof=1)
    limits = (
        f"limits of agreement \N{MINUS SIGN}{0.5 + reach:.2f} to +{reach - 0.5:.2f} mN"
    )
    dashed = [
        line.get_ydata()[0]
        for line in axes.lines
        if line.get_linestyle() == "--" and line.get_color() == BLACK
    ]
    np.testing.assert_allclose(dashed, [-0.5 - reach, -0.5 + reach], rtol=1e-6)
    np.testing.assert_allclose(lines["mean \N{MINUS SIGN}0.50 mN"][:, 1], -0.5)
    read = [
        "read as class 1",
        "misread",
        "not usable",
        "90 % interval",
        "label error, 90 %: ±1.64 mN",
    ]
    assert legend_of(figure) == [*read, "mean \N{MINUS SIGN}0.50 mN", limits]


def test_a_legend_lists_only_what_occurs(logged: Recording) -> None:
    right, *_ = read_evaluation().frames
    assert legend_of(draw_trial_forces(evaluation_of([right]))) == ["read as class 1"]
    residuals = [
        "read as class 1",
        "90 % interval",
        "label error, 90 %: ±1.64 mN",
        "mean +2.00 mN",
    ]
    assert legend_of(draw_residuals(evaluation_of([right]))) == residuals
    without_class_1 = ["read as class 0", "read as class 2", "not usable", "misread"]
    assert legend_of(draw_trial_forces(answers())) == without_class_1
    assert [text.get_text() for text in drawn_log(logged).get_legend().get_texts()] == [
        "as logged",
        "filtered",
        "frames",
    ]


def files_of(source: str) -> dict[str, bytes]:
    """The files that a page saves, by name."""
    found = re.findall(r'download="([^"]*)" href="data:[^"]*;base64,([^"]*)"', source)
    assert len({name for name, _ in found}) == len(found) == source.count("download=")
    return {name: base64.b64decode(content) for name, content in found}


def test_a_page_saves_its_figures_frames_and_tables(tmp_path: Path) -> None:
    looks, evaluation = read_frames(
        tmp_path / "eye", "no wall", modulus_source="population"
    )
    source = write_and_read(tmp_path, evaluation, looks)
    files = files_of(source)
    frames = [f"{look.answer.file}.jpg" for look in looks]
    assert [*files] == ["confusion.csv", "residuals.svg", *frames, "frames.csv"]
    write_figure(draw_residuals(evaluation), tmp_path / "residuals.svg")
    assert files["residuals.svg"] == (tmp_path / "residuals.svg").read_bytes()
    shown = [
        base64.b64decode(each)
        for each in re.findall(r'src="data:[^"]*;base64,([^"]*)"', source)
    ]
    assert shown == [files[name] for name in ("residuals.svg", *frames)]
    rows = list(csv.DictReader(StringIO(files["frames.csv"].decode())))
    assert [row["file"] for row in rows] == [look.answer.file for look in looks]
    assert [row["predicted_force_mn"] for row in rows] == ["21.0", "21.0", "", "21.0"]
    confusion = list(csv.reader(StringIO(files["confusion.csv"].decode())))
    assert confusion[2] == [
        "target class 1: 5 to 30 mN",
        "0",
        "2",
        "2",
        "0.50 (0.15 to 0.85)",
    ]


def test_a_saved_table_has_numbers_texts_and_empty_cells() -> None:
    row = [
        "=2",
        3,
        "+1.5",
        "-0.40",
        "\N{EN DASH}",
        "2 \N{EN DASH} 3",
        "1.0\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}0.2",
    ]
    _, content = PageTable("abcdefg", [row]).csv.split(";base64,")
    assert (
        base64.b64decode(content).decode().splitlines()[1]
        == "'=2,3,1.5,-0.4,,2 \N{EN DASH} 3,1.0 ± 0.2"
    )


@in_chromium
def test_a_browser_saves_a_figure_and_a_table_without_a_network(
    browser: Browser, wide: Path
) -> None:
    page = browser.new_context(offline=True).new_page()
    page.goto(wide.as_uri())

    for name, content in files_of(wide.read_text(encoding="utf-8")).items():
        if name in ("residuals.svg", "frames.csv"):
            with page.expect_download() as download:
                page.click(f'a[download="{name}"]')
            assert Path(download.value.path()).read_bytes() == content

    page.close()


def luminance(colour: str) -> float:
    """Relative luminance of a colour (WCAG 2.2)."""
    shares = np.array([int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)])
    return float(
        np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
        @ [0.2126, 0.7152, 0.0722]
    )


def contrast(one: str, other: str) -> float:
    low, high = sorted(map(luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


@pytest.fixture
def line_art(logged: Recording) -> list[Figure]:
    curves = {"training_loss": (1.0, 0.5), "validation_loss": (0.9, 0.4)}
    network = draw_network(
        (140, 40), (600, 600), ("class 0", "class 1", "class 2"), 0.5
    )
    drawn = [
        draw_model(Study()),
        network,
        draw_curves(curves, "epoch"),
        draw_calibration(calibration_of_a_sealed_eye()),
    ]
    library = draw_library(load_force_reader(SHIPPED_READER).library)

    return [
        *drawn,
        library,
        draw_residuals(read_evaluation()),
        draw_trial_forces(answers()),
        draw_recording(logged),
    ]


def test_no_colour_of_a_figure_vanishes_on_dark_paper(
    line_art: list[Figure], tmp_path: Path
) -> None:
    on_dark = {light.lower(): dark for light, dark in DARK.items()}
    for number, figure in enumerate(line_art):
        path = tmp_path / f"{number}.svg"
        write_figure(figure, path)
        source = path.read_text(encoding="utf-8")
        rules = dict(
            re.findall(
                r'\[style\*="(?:fill|stroke):'
                r' (#\w{6})"\]\{(?:fill|stroke):(#\w{6})!important\}',
                source,
            )
        )
        assert rules == on_dark
        assert all(
            text.get_color() not in ("black", "#000000")
            for text in figure.findobj(Text)
        )

        for colour in set(
            re.findall(r"(?:fill|stroke): (#\w{6})", source.partition("</style>")[2])
        ):
            if colour not in (PAPER.lower(), LIGHT.lower(), SHADE.lower()):
                assert contrast(rules.get(colour, colour), DARK[PAPER]) > 1.6, (
                    number,
                    colour,
                )


@in_chromium
def test_a_figure_has_as_much_ink_in_dark_mode_as_in_light(
    browser: Browser, line_art: list[Figure]
) -> None:
    for figure in line_art:
        inked = []
        for scheme in ("light", "dark"):
            page = browser.new_page(
                viewport={"width": 700, "height": 500}, color_scheme=scheme
            )
            page.set_content(
                '<html style="color-scheme: light dark"><img width="700"'
                f' src="{svg_uri(figure)}">'
            )
            shown = cv2.imdecode(
                np.frombuffer(page.locator("img").screenshot(), np.uint8),
                cv2.IMREAD_GRAYSCALE,
            )
            page.close()
            paper = np.bincount(shown.ravel()).argmax()
            inked.append(np.count_nonzero(np.abs(shown.astype(int) - paper) > 12))
            assert (paper < 60) == (scheme == "dark")

        assert inked[1] > 0.6 * inked[0]


def test_the_overlap_of_slices_is_1_if_they_are_the_same_and_0_if_they_have_nothing_in_common():
    half = np.repeat(np.array([[255, 0]], dtype=np.uint8), 7, axis=1)
    assert [dice(half, other) for other in (half, 255 - half, 0 * half)] == [
        1.0,
        0.0,
        0.0,
    ]
    assert dice(0 * half, 0 * half) == 1.0


WIDTH_M = 15e-3
COLUMNS = 512
LATERAL_M = (np.arange(COLUMNS) + 0.5) * WIDTH_M / COLUMNS


def dented(lateral_m: np.ndarray) -> np.ndarray:
    """Depth of an eye with a dent at 0, m."""
    return (
        12e-3
        - np.sqrt((12e-3) ** 2 - lateral_m**2)
        + 1.5e-3 * np.exp(-((lateral_m / 1.5e-3) ** 2))
    )


def wall() -> WallSection:
    lateral_m = np.linspace(-9e-3, 9e-3, 400)
    outer = np.stack([lateral_m, dented(lateral_m)], axis=1)
    return WallSection(outer, outer + np.array([0.0, 0.5e-3]))


def test_a_wall_is_laid_on_the_surface_though_a_third_of_it_is_unseen_or_in_the_middle():
    for shift_m, down_m in ((0.0, 0.4e-3), (0.25e-3, 0.9e-3), (-0.4e-3, 0.1e-3)):
        surface_m = dented(LATERAL_M - WIDTH_M / 2 - shift_m) + down_m
        surface_m[100:270] = np.nan
        surface_m[300:310] += 1e-3  # a wrong stretch
        laid = laid_on_surface(wall(), surface_m, WIDTH_M)
        moved = laid.outer[0] - wall().outer[0] - [WIDTH_M / 2, 0.0]
        # half a step of the shifts
        assert moved == pytest.approx([shift_m, down_m], abs=13e-6)
        assert laid.inner - laid.outer == pytest.approx(wall().inner - wall().outer)

    laid = laid_on_surface(wall(), np.full(COLUMNS, np.nan), WIDTH_M)
    assert laid.outer == pytest.approx(wall().outer + np.array([WIDTH_M / 2, 0.0]))


@pytest.fixture
def logged(tmp_path: Path) -> Recording:
    """A recording whose sensor has a zero of 50 mN."""
    recording = read_recording(
        with_log(write_small_recording(tmp_path / "r", frames=12))
    )
    assert recording.forces is not None

    return replace(
        recording,
        forces=replace(recording.forces, wrench_sc=recording.forces.wrench_sc + 0.05),
    )


def drawn_log(recording: Recording, trials: Sequence[Trial] = ()) -> Axes:
    axes = Figure().subplots()
    draw_log(axes, recording, trials)
    return axes


def test_a_force_log_is_drawn_in_millinewtons_with_the_times_of_all_frames_and_labels_by_class(
    logged: Recording,
) -> None:
    labels = ((1.0, 0.04, 2), (1.05, None, None), (1.1, 0.01, 1))
    trials = [
        Trial(file="a.png", time_s=at, measured_force_n=force, target=target)
        for at, force, target in labels
    ]
    axes = drawn_log(logged, trials)
    raw, filtered, first, second = axes.lines
    np.testing.assert_allclose(
        np.ptp(raw.get_ydata()), 1e3 * np.ptp(logged.forces.force_n("fz"))
    )
    off = raw.get_ydata() + 1e3 * logged.forces.force_n("fz")  # contact_sign is -1
    np.testing.assert_allclose(off, off[0])
    assert np.mean(raw.get_ydata()) == pytest.approx(np.mean(filtered.get_ydata()))
    assert filtered.get_ydata().max() == pytest.approx(10.0, abs=0.5)
    marks = [segment[0][0] for segment in axes.collections[0].get_segments()]
    assert marks == pytest.approx([frame.time_s for frame in logged.frames])
    assert [np.column_stack(line.get_data()).tolist() for line in (first, second)] == [
        [[1.1, 10.0]],
        [[1.0, 40.0]],
    ]


def test_a_figure_has_the_format_of_its_name_and_the_same_bytes_each_time(
    tmp_path: Path,
) -> None:
    for ending, start in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")):
        for name in ("one", "two"):
            figure = Figure()
            figure.subplots().plot([0, 1], [1, 0], label="line")
            figure.suptitle("検査")  # the font lacks these: without a warning
            write_figure(figure, tmp_path / f"{name}{ending}")

        content = (tmp_path / f"one{ending}").read_bytes()
        assert content.startswith(start)
        assert content == (tmp_path / f"two{ending}").read_bytes()

    with pytest.raises(InputError, match=r"a\.xlsx.*\.png, \.svg, \.pdf"):
        write_figure(Figure(), tmp_path / "a.xlsx")

    assert len(list(tmp_path.iterdir())) == 6


def test_a_sheet_shows_the_worst_frames_and_others_in_even_steps() -> None:
    badness = [(number == 7, float(number)) for number in range(2000)]
    shown = shown_on_sheet(badness)
    assert shown[:WORST] == [7, *range(1999, 2000 - WORST, -1)]
    assert len(shown) == MOST
    assert np.ptp(np.diff(shown[WORST:])) <= 2  # in even steps, but for number 7
    assert shown_on_sheet(badness[:5]) == [4, 3, 2, 1, 0]


def test_a_frame_has_both_walls_where_they_are_seen_its_verdict_and_the_disagreement(
    tmp_path: Path,
) -> None:
    looked_at_frames(tmp_path / "eye", 1)
    path = tmp_path / "eye" / "frames" / "0001.png"
    frame, found = segmented_frame(path, Scan(), Scan(), finder_of(SHIPPED_WALL_FINDER))
    assert found.methods is not None
    unseen = replace(
        found.methods, classical=replace(found.methods.classical, inner_found=False)
    )
    refused = replace(found, usable=False, reason="too weak", methods=unseen)
    figure = draw_sheet(
        [sheet_frame("x" * 50 + ".png", frame, one) for one in (refused, found)],
        "2 frames",
    )
    words = f"usable, 562 µm, disagreement {found.methods.disagreement:.2f}"
    assert [axes.get_xlabel() for axes in figure.axes] == [
        f"not {words.replace(' 562 µm,', '')}\ntoo weak",
        words,
    ]

    for axes, classical in zip(figure.axes, (1, 2), strict=True):
        assert axes.texts[0].get_text() == "…" + "x" * 20 + ".png"
        assert [line.get_color() for line in axes.lines] == [
            WALLS[0][0]
        ] * classical + [WALLS[1][0]] * 2
        np.testing.assert_allclose(
            axes.lines[0].get_ydata() * found.rows - 0.5,
            found.methods.classical.outer_row,
        )

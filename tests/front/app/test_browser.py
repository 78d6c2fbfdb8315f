"""A whole session of the app in a real browser: files to a recording, a wall corrected,
E, and forces.
"""

import json
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from chromium import NEEDS_CHROMIUM
from playwright.sync_api import Browser, Page, Route, expect
from running_app import TOKEN, running_app
from small_recordings import evaluation_of, frame_answer

import scleraforce as sf
from scleraforce.base.kept_results import keep_result
from scleraforce.calibration.evaluation import FrameAnswer
from scleraforce.records.remark import Remark

pytestmark = NEEDS_CHROMIUM
FORCES_N = (0.012, 0.024, 0.036, 0.004, 0.015, 0.034)
LONG_MS = 120_000
ANSWERS = {
    "width_mm": "15",
    "depth_mm": "4",
    "refractive_index": "1",
    "bits": "12",
    "eye": "mine",
    "gauge": "22",
    "gap_mm": "0.5",
    "thickness_um": "650",
    "iop_mmhg": "2",
    "clock_offset_s": "0",
}


@pytest.fixture(scope="module")
def eye(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("eye") / "eye-a"
    sf.phantom(
        path,
        eye="eye-a",
        forces_n=list(FORCES_N),
        thickness_m=650e-6,
        youngs_modulus_pa=0.3e6,
        globe="open",
    )

    return path


@pytest.fixture
def files(eye: Path, tmp_path: Path) -> list[str]:
    """A laboratory's own: a stack without a scale, a log in ms and mN, and the frames'
    times.
    """
    frames = [
        cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        for path in sorted((eye / "frames").iterdir())
    ]
    tifffile.imwrite(tmp_path / "scan.tif", np.array(frames), photometric="minisblack")
    log = np.loadtxt(eye / "forces.csv", delimiter=",", skiprows=1)
    table = np.column_stack([1e3 * log[:, 0], -1e3 * log[:, 3]])
    np.savetxt(
        tmp_path / "log.csv", table, "%.2f", ",", header="clock,pull", comments=""
    )
    with (tmp_path / "log.csv").open("a") as log_file:
        log_file.write("17")  # a line that was cut off: the import notes it
    (tmp_path / "times.csv").write_bytes((eye / "frames.csv").read_bytes())

    return [str(tmp_path / name) for name in ("scan.tif", "log.csv", "times.csv")]


@contextmanager
def opened(
    browser: Browser,
    folder: Path,
    width: int = 1280,
    scheme: Any = "light",
    held: list[Route] | None = None,
    complaints: list[str] | None = None,
) -> Iterator[Page]:
    """The app's page on a folder. Its first request for the state is `held` back, and
    `complaints` are the faults of its scripts.
    """
    found = [] if complaints is None else complaints
    with running_app(folder) as client:
        context = browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme=scheme
        )
        page = context.new_page()
        page.set_default_timeout(LONG_MS)
        expect.set_options(timeout=LONG_MS)
        page.on("pageerror", lambda fault: found.append(str(fault)))
        address = f"http://127.0.0.1:{client.port}/?token={TOKEN}"
        if held is None:
            page.goto(address)
        else:
            page.route("**/api/state*", lambda route: held.append(route), times=1)
            with page.expect_request("**/api/state*"):
                page.goto(address, wait_until="commit")
        yield page
        context.close()


@contextmanager
def faultless(browser: Browser, folder: Path) -> Iterator[Page]:
    """The app's page on a folder, of which no script fails."""
    complaints = list[str]()
    with opened(browser, folder, complaints=complaints) as page:
        yield page
    assert complaints == []


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder."""
    (tmp_path / "folder").mkdir()
    return tmp_path / "folder"


@pytest.fixture
def mine(eye: Path, tmp_path: Path) -> Path:
    """A folder with one recording, `mine`."""
    shutil.copytree(eye, tmp_path / "app" / "mine")
    return tmp_path / "app"


def import_(page: Page, files: list[str], out: str) -> None:
    page.set_input_files("#files", files)
    expect(page.locator("#sources li")).to_have_count(3)
    times = page.locator("#sources li:has-text('times.csv')")
    expect(times).to_contain_text("times of the frames")
    expect(times.locator("input")).to_be_checked()
    expect(page.locator("[data-column=time]")).to_have_class("pair missing")
    page.select_option("[data-column=time] .name", "clock")
    page.select_option("[data-column=time] .unit", "ms")
    page.select_option("[data-column=fz] .name", "pull")
    page.select_option("[data-column=fz] .unit", "other")
    page.fill("[data-column=fz] .typed", "1000/N")
    expect(page.locator("#source-size")).to_have_text(
        "6 frames of 512 x 512 pixels (depth x lateral)"
    )
    expect(page.locator("[data-name=gauge]")).to_have_class("missing")

    for name, text in ANSWERS.items():
        page.fill(f"[data-name={name}] input", text)

    expect(page.locator("[data-name=times] select")).to_have_value("sources/times.csv")
    page.select_option("[data-name=contact_sign] select", "1")
    page.select_option("[data-name=globe] select", "open")
    page.fill("#import-out", out)
    expect(page.locator("#import-command")).to_contain_text("--gap-mm=0.5")
    expect(page.locator("#import-command")).to_contain_text(f"--out={out}")
    page.click("#import-run")
    expect(page.locator("#frames")).to_be_visible()
    expect(page.locator("#place")).to_contain_text("1 of 6")


def drag(page: Page, down: float, file: str = "0001.png") -> None:
    """Drag the handle of the surface in the middle of the frame down by a share of the
    frame's depth.
    """
    place: dict[str, Any] = page.evaluate(
        """() => { const box = document.getElementById("frame").getBoundingClientRect();
             return { x: box.x, y: box.y, width: box.width, height: box.height }; }"""
    )
    look = page.request.get(f"{page.url}api/look?name=mine&file={file}").json()
    column = round(6.5 * 512 / 13)
    x = place["x"] + (column + 0.5) / 512 * place["width"]
    y = place["y"] + (look["wall"]["outer"][column] + 0.5) / 512 * place["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + down * place["height"], steps=4)
    page.mouse.up()


def test_files_become_a_recording_a_corrected_wall_a_modulus_and_forces(
    browser: Browser, folder: Path, files: list[str]
) -> None:
    with faultless(browser, folder) as page:
        session(page, folder, files)


def session(found: Page, folder: Path, files: list[str]) -> None:
    expect(found.locator("#import")).to_be_visible()  # an empty folder begins here
    import_(found, files, "mine")
    assert len(sf.read_recording(folder / "mine").frames) == len(FORCES_N)
    expect(found.locator("#verdict")).to_contain_text("mN (90 %:")
    expect(found.locator("#read-by")).to_have_text("Read without a calibration.")
    remarks = sf.read_recording(folder / "mine").remarks
    assert "log-mended" in {remark.code for remark in remarks}
    order = ("doubt", "caution", "info")
    severities = sorted((one.severity for one in remarks), key=order.index)
    imported = [re.compile(f"^{severity} ") for severity in severities]
    expect(found.locator("#import-remarks li")).to_have_text(imported)

    found.click("[data-step=correct]")
    expect(found.locator("#accept")).to_be_enabled()
    second = folder / "mine" / "frames" / "0001.png"
    before = sf.read("default", second).segmentation
    drag(found, 0.05)
    expect(found.locator("#draft")).to_have_text("draft saved")
    found.keyboard.press("Control+z")
    found.keyboard.press("Control+y")
    handle = found.locator("[role=slider]:focus")
    found.locator("[role=slider][data-name=outer][tabindex='0']").focus()
    row = float(handle.get_attribute("aria-valuenow") or "nan")
    found.keyboard.press("Shift+ArrowDown")
    found.keyboard.press("ArrowUp")
    expect(handle).to_have_attribute("aria-valuetext", f"row {row + 9:.1f}")
    found.keyboard.press("ArrowLeft")
    expect(handle).to_have_attribute(
        "aria-label", f"surface, column {round(5.5 * 512 / 13)}"
    )
    found.keyboard.press("Control+z")
    found.keyboard.press("Control+z")
    found.click("#accept")
    expect(found.locator("#verdict")).to_contain_text("wall: corrected")
    after = sf.read("default", second).segmentation
    assert before is not None
    assert after is not None
    assert after.source == "corrected"
    moved = (after.outer_row - before.outer_row)[256]
    assert moved == pytest.approx(0.05 * 512, abs=2.0)
    found.click("#restore")
    expect(found.locator("#verdict")).not_to_contain_text("corrected")
    assert list((folder / "mine" / "walls").iterdir()) == []

    found.click("[data-step=calibrate]")
    found.check("#calibrate .recordings input")
    expect(found.locator("#calibrate-command")).to_have_text(
        "scleraforce calibrate mine --frames=3 --out=calibration.json"
    )
    found.click("#calibrate-run")
    expect(found.locator("#calibrate-result tbody tr")).to_have_count(1)
    mean_mpa = json.loads((folder / "calibration.json").read_text())["eyes"]["mine"][
        "mean_mpa"
    ]
    expect(found.locator("#calibrate-result tbody")).to_contain_text(f"{mean_mpa:.3f}")

    found.click("[data-step=read]")
    found.check("#read .recordings input")
    found.select_option("#read-calibration", "calibration.json")
    found.click("#read-run")
    expect(found.locator("#read-result tbody tr")).to_have_count(len(FORCES_N))
    expect(found.locator("#read-result svg.plot")).to_have_count(2)

    with found.expect_download() as caught:
        found.click("#read-result button:has-text('CSV')")

    lines = Path(caught.value.path()).read_text().splitlines()
    assert lines[0].startswith("recording,eye,file,time_s,")
    times = [float(line.split(",")[3]) for line in lines[1:]]
    assert times == [
        entry.time_s for entry in sf.read_recording(folder / "mine").frames
    ]
    with found.expect_download() as caught:
        found.click("#read-result button:has-text('SVG') >> nth=0")

    assert Path(caught.value.path()).read_text().startswith("<svg")
    found.reload()

    for step, rows in (
        ("calibrate", 1),
        ("read", len(FORCES_N)),
    ):
        # the last results are shown again
        found.click(f"[data-step={step}]")
        expect(found.locator(f"#{step}-result tbody tr")).to_have_count(rows)

    row = found.locator("#read-result tbody tr >> nth=0")
    file = row.locator("td >> nth=0").inner_text().removeprefix("mine/")
    force = row.locator("td >> nth=2").inner_text()
    row.click()
    expect(found.locator("#place")).to_contain_text(file)
    expect(found.locator("#verdict")).to_contain_text(f"{force} mN (90 %:")
    expect(found.locator("#read-by")).to_have_text(
        "Read with calibration calibration.json, as in Read."
    )
    expect(found.locator("#look-command")).to_have_text(
        f"scleraforce read default --calibration=calibration.json mine/frames/{file}"
    )
    expect(found.locator("#import-remarks li")).to_have_text(imported)
    (folder / "calibration.json").rename(folder / "elsewhere.json")
    found.reload()
    expect(found.locator("#read-by")).to_contain_text("calibration.json, with which")


@pytest.mark.parametrize(
    ("width", "scheme"), [(400, "light"), (400, "dark"), (1280, "dark")]
)
def test_the_page_fits_its_window(
    browser: Browser, eye: Path, width: int, scheme: Any
) -> None:
    with opened(browser, eye.parent, width, scheme) as page:
        expect(page.locator("#verdict")).not_to_have_text("")
        for step in ("import", "look", "correct", "calibrate", "read"):
            page.click(f"[data-step={step}]")
            assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_keys_go_through_the_frames(browser: Browser, eye: Path) -> None:
    with opened(browser, eye.parent) as page:
        place = page.locator("#place")
        expect(place).to_contain_text("1 of 6")
        for key, number in (("ArrowRight", 2), ("ArrowRight", 3), ("ArrowLeft", 2)):
            page.keyboard.press(key)
            expect(place).to_contain_text(f"{number} of 6")
        page.keyboard.press(" ")
        expect(place).to_contain_text("6 of 6")


def test_a_draft_stays_with_its_frame_and_faults_are_shown(
    browser: Browser, mine: Path
) -> None:
    files = [entry.file for entry in sf.read_recording(mine / "mine").frames]
    (mine / "mine" / "frames" / files[1]).write_bytes(b"\x89PNG damaged")

    with opened(browser, mine) as page:
        page.click("[data-step=correct]")
        expect(page.locator("#verdict")).to_contain_text("mN")
        drag(page, 0.05, files[0])
        page.keyboard.press("ArrowRight")  # before the draft is sent
        expect(page.locator("#fault")).to_contain_text(files[1])
        page.click("#accept")
        page.keyboard.press("ArrowLeft")
        expect(page.locator("#verdict")).to_contain_text("mN")
        drafts = [path.name for path in (mine / "mine" / "walls").iterdir()]
        assert drafts == [f".{Path(files[0]).stem}.draft.json"]
        page.click("[data-step=read]")
        page.check("#read .recordings input")
        page.click("#read-run")
        expect(page.locator("#fault")).to_contain_text(files[1])


def test_a_duplicated_tab_is_read_only_and_an_empty_folder_has_no_faults(
    browser: Browser, folder: Path
) -> None:
    with faultless(browser, folder) as found:
        expect(found.locator("#import")).to_be_visible()
        with found.expect_popup() as popup:
            found.evaluate("open('/')")

        expect(popup.value.locator("#read-only")).to_be_visible()
        expect(found.locator("#read-only")).to_be_hidden()
        popup.value.close()

        for step in ("look", "correct"):
            found.click(f"[data-step={step}]")
            for button in ("#play", "#next", "#back", "#zoom-in"):
                found.click(button)

            expect(found.locator("#fault")).to_be_hidden()


def judged_frames() -> list[FrameAnswer]:
    """One frame of each mark, in its order; none has a picture."""
    force = {"force_n": 0.020, "interval_n": (0.018, 0.022)}
    said: tuple[dict[str, Any], ...] = (
        force,
        {"force_n": 0.014, "interval_n": (0.013, 0.016)},
        {"force_n": 0.031, "interval_n": (0.015, 0.045), "predicted": 2},
        {"force_n": 0.040, "interval_n": (0.038, 0.042), "predicted": 2},
        {**force, "calibration": True},
    )
    return [
        frame_answer(
            recording="mine", eye="mine", file=f"000{n}.png", time_s=float(n), **each
        )
        for n, each in enumerate(said)
    ]


@pytest.mark.parametrize(
    ("width", "scheme"), [(1280, "light"), (400, "light"), (400, "dark")]
)
def test_wrong_classes_and_missed_intervals_are_marked_apart(
    browser: Browser, mine: Path, width: int, scheme: Any
) -> None:
    evaluation = evaluation_of(judged_frames(), kind="reader")
    doubt = Remark("other-eye", "another eye", about="mine").to_dict()
    info = {**doubt, "severity": "info", "words": "a note", "about": ""}
    said = {"notes": ["a note"], "remarks": [info, doubt]}
    (mine / ".scleraforce").mkdir()
    keep_result(
        {
            "command": "scleraforce evaluate default mine",
            "time_utc": "2026-01-02T03:04:05Z",
            "result": evaluation.to_dict() | said,
            "rows": evaluation.rows(),
            "model": "default",
            "calibration": None,
            "recordings": ["mine"],
        },
        mine / ".scleraforce" / "evaluate.kept",
    )

    held = list[Route]()
    with opened(browser, mine, width, scheme, held) as page:
        page.click("[data-step=read]")  # before the page knows the folder
        held[0].continue_()
        shapes = {
            "right": "circle",
            "missed": "path.diamond",
            "wrong": "path.cross",
            "both": "path.diamond + path.cross",
            "none": "circle.hollow",
        }
        expect(page.locator("#read-result tbody tr")).to_have_count(len(shapes))

        for n, (mark, shape) in enumerate(shapes.items()):
            row = page.locator(f"#read-result tbody tr:has-text('000{n}.png')")
            expect(row).to_have_attribute("data-mark", mark)
            expect(row.locator(f".mark {shape}")).to_have_count(1)
            # over time, and as a residual if it is compared with its label
            drawn = page.locator(f"#read-result .plot g[data-mark={mark}]")
            expect(drawn).to_have_count(1 if mark == "none" else 2)
            expect(drawn.first.locator(shape)).to_have_count(1)
            expect(page.locator(f".legend [data-mark={mark}]")).to_contain_text(": 1")

        rows = page.locator("#read-result tbody")
        expect(rows).to_contain_text("wrong class: the label is 1; the interval misses")
        expect(rows.locator("td.wrong")).to_have_text(["2", "2"])
        expect(rows.locator("td.missed")).to_have_text(["38.0 to 42.0", "13.0 to 16.0"])
        expect(page.locator("#read-result .plot .bar.missed")).to_have_count(2)
        # the doubt comes first; the note is a remark already
        expect(page.locator("#read-result .notes li")).to_have_text(
            ["doubt mine: another eye", "info a note"]
        )
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_a_reading_is_stopped_and_says_so(browser: Browser, mine: Path) -> None:
    frames = mine / "mine" / "frames.csv"
    lines = frames.read_text().splitlines()
    first = mine / "mine" / "frames" / "0001.png"
    for n in range(100, 4000):  # more than can be read before the click
        first.with_name(f"{n:04}.png").hardlink_to(first)
        lines.append(f"{n:04}.png,{n}")
    frames.write_text("\n".join(lines) + "\n")

    with opened(browser, mine) as page:
        page.click("[data-step=read]")
        page.check("#read .recordings input")
        page.fill("#read-html", "page.html")
        page.click("#read-run")
        expect(page.locator("#job-percent")).to_have_text(re.compile("[1-9]"))
        page.click("#read-run")
        expect(page.locator("#fault")).to_contain_text("another command is running")
        page.click("#job-stop")
        expect(page.locator("#fault")).to_have_text("stopped")
        expect(page.locator("#job")).to_be_hidden()
        assert not (mine / "page.html").exists()
        assert not (mine / ".scleraforce").exists()


def test_columns_that_the_header_names_are_chosen_already(
    browser: Browser, folder: Path, files: list[str], tmp_path: Path
) -> None:
    log = tmp_path / "named.csv"
    rows = "".join(f"{n},{n},{2 * n}\n" for n in range(200))
    log.write_text(f"Time (ms),Fz (mN),other\n{rows}")
    with faultless(browser, folder) as found:
        found.set_input_files("#files", [files[0], str(log)])
        time, force = (found.locator(f"[data-column={of}]") for of in ("time", "fz"))
        command = expect(found.locator("#import-command"))
        expect(time.locator(".name")).to_have_value("Time (ms)")
        expect(time.locator(".unit")).to_have_value("ms")
        expect(force.locator(".unit")).to_have_value("mN")
        command.not_to_contain_text("--column")
        force.locator(".name").select_option("other")
        force.locator(".unit").select_option("N")
        command.to_contain_text("--column=fz=other:N")
        # without the log nothing is said of its columns
        used = found.locator("#sources li:has-text('named.csv') input")
        used.uncheck()
        command.not_to_contain_text("--column")
        expect(found.locator("#columns")).to_be_hidden()
        used.check()
        command.to_contain_text("--column=fz=other:N")
        force.locator(".name").select_option("")  # as the header says again
        expect(force.locator(".unit")).to_have_value("mN")
        command.not_to_contain_text("--column")

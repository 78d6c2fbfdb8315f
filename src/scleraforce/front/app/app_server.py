"""The app's web server: one page on the loopback interface, for users with the token of
its address.
"""

import json
import secrets
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from secrets import compare_digest
from threading import Lock
from time import monotonic
from typing import Annotated, Any, Literal

import uvicorn
from fastapi import FastAPI, Query, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import PlainTextResponse, RedirectResponse
from fastapi.staticfiles import StaticFiles
from pydantic import BaseModel, Field, FiniteFloat, ValidationError

from scleraforce.base.arrays import Bytes
from scleraforce.base.errors import InputError
from scleraforce.base.kept_results import ENDING, kept_result
from scleraforce.front.api.reading_frames import save_wall
from scleraforce.front.app.recording_views import (
    RecordingViews,
    mask_between,
    png,
    remove_draft,
    write_draft,
)
from scleraforce.front.app.request_end import EndsWithRequest
from scleraforce.front.app.running_commands import CommandWords, Job, command_line
from scleraforce.front.app.source_views import ANSWERS, Checked, Sources
from scleraforce.front.app.work_folder import MOST_UPLOAD_BYTES, SOURCES, Folder
from scleraforce.live.console.server import OwnPagesOnly
from scleraforce.recordings.drawn_walls import remove_wall
from scleraforce.recordings.exported_files import csv_text
from scleraforce.recordings.import_sources import ImportOptions
from scleraforce.recordings.recording_folder import Recording, check_alone
from scleraforce.records.model_folder import SHIPPED
from scleraforce.records.scan import Plane, parse_plane

HOST = "127.0.0.1"
RESULTS = ".scleraforce"  # folder of the last results, shown again after a reload
SILENT_S = 6.0  # after which another tab may write
UPLOAD = "/api/source"
MOST_JSON_BYTES = 4 * 2**20  # of a request, except a dropped file
BUSY = "another tab is working in this folder; close it first"


class Asked(BaseModel):
    """Operands of a command, planes of some, its options by the names of their fields,
    and a log's columns.
    """

    operands: list[str] = Field(min_length=1, max_length=20000)
    planes: dict[str, str] = {}
    options: dict[str, int | FiniteFloat | str | bool] = {}
    columns: list[str] = Field([], max_length=20)

    def read(
        self, folder: Folder
    ) -> tuple[list[Path], list[Plane | None], ImportOptions]:
        """Return the paths of an import, their planes and its options; raises
        `InputError` or `ValidationError`.
        """
        given: dict[str, Any] = dict(self.options)
        given |= {
            name: folder.inside(str(given[name])) for name in {"times"} & set(given)
        }
        planes = [
            parse_plane(self.planes[name]) if name in self.planes else None
            for name in self.operands
        ]

        return (
            [folder.whole(name) for name in self.operands],
            planes,
            Checked(**given, columns=tuple(self.columns)),
        )


class CommandRequest(Asked):
    """A command, with the name of the file or folder that it writes."""

    command: str
    out: str = ""


class Drawn(BaseModel):
    """A wall: rows of its boundaries in each column, and columns that are not
    judged.
    """

    outer: list[FiniteFloat | None] = Field(max_length=16384)
    inner: list[FiniteFloat | None] = Field(max_length=16384)
    unseen: list[int] = Field(max_length=16384)


OPTIONS = {
    "import": ANSWERS,
    "calibrate": {
        "frames",
        "without_force",
        "parameters",
        "thickness_um",
        "calibration",
    },
    "evaluate": {"calibration", "html"},
}
NEW_FILES = ("html",)
OLD_FILES = ("calibration", "times")
DIGITS = 15  # of a number: a clock counts from 1970, in ms


def words_of(run: CommandRequest, folder: Folder, spelled: CommandWords) -> list[str]:
    """Return a command's words, checked: known options, paths inside the folder, and
    nothing that exists is written.
    """
    if run.command not in OPTIONS:
        raise InputError(f"{run.command}: not a command of the app")

    bundled = run.operands[:1] if run.command == "evaluate" else []
    bundled = [name for name in bundled if name in SHIPPED]
    for name in run.operands[len(bundled) :] + [
        str(run.options[key]) for key in OLD_FILES if key in run.options
    ]:
        if not folder.whole(name).exists():
            raise InputError(f"{name}: does not exist")

    words = [run.command]
    for plane in dict.fromkeys(["", *run.planes.values()]):
        words += [f"{spelled.flag_of('planes')}={plane}"] if plane else []
        words += [
            _operand(name) for name in run.operands if run.planes.get(name, "") == plane
        ]

    for name, value in run.options.items():
        if name not in OPTIONS[run.command]:
            raise InputError(f"{name}: not an option of {run.command} in the app")
        if name in NEW_FILES:
            folder.new(str(value))
        text = f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)
        flag = spelled.flag_of(name)
        if value is True:
            words.append(flag)
        elif value is not False:
            words.append(f"{flag}={text}")

    words += [f"{spelled.flag_of('columns')}={column}" for column in run.columns]
    if run.command != "evaluate":
        folder.new(run.out)
        words.append(f"{spelled.flag_of('out')}={run.out}")

    return words


def _line(fault: Exception, folder: Folder, spelled: CommandWords) -> str:
    if isinstance(fault, RequestValidationError | ValidationError):
        first = fault.errors()[0]
        return (
            f"{'.'.join(map(str, first['loc'])).removeprefix('body.')}: {first['msg']}"
        )
    if isinstance(fault, OSError):
        return (
            f"{Path(fault.filename).name if fault.filename else 'disk'}:"
            f" {fault.strerror}"
        )

    text: str = spelled.worded(str(fault))
    return text.replace(f"{folder.root}/", "")


def _operand(name: str) -> str:
    return f"./{name}" if name.startswith("-") else name


@dataclass
class Holder:
    """The tab that may write: the first one that asks, until it is silent."""

    tab: str = ""
    heard_s: float = 0.0

    def is_held_by(self, tab: str) -> bool:
        """Return whether a tab may write, and note that it is there."""
        now_s = monotonic()
        if tab and (not self.tab or now_s - self.heard_s > SILENT_S):
            self.tab = tab
        if tab == self.tab:
            self.heard_s = now_s
        return bool(tab) and tab == self.tab


def app_of(
    root: Path, token: str, port: int, spelled: CommandWords, once: str = ""
) -> OwnPagesOnly:
    """Return the application for a folder: only requests with the cookie are answered.

    The cookie is given for the token each time, and for `once` a single time.
    """
    folder = Folder(root.resolve())
    views = RecordingViews()
    sources = Sources()
    holder = Holder()
    jobs = list[Job]()
    writing = Lock()
    tokens = {token, once} - {""}
    cookie = f"scleraforce-{port}"
    session = secrets.token_urlsafe(32)

    async def refused(_: Request, fault: Exception) -> Response:
        return PlainTextResponse(_line(fault, folder, spelled), 422)

    faults: Any = dict.fromkeys(
        (InputError, OSError, RequestValidationError, ValidationError), refused
    )
    app = FastAPI(
        docs_url=None, redoc_url=None, openapi_url=None, exception_handlers=faults
    )

    @app.middleware("http")
    async def check(
        request: Request, answer: Callable[[Request], Awaitable[Response]]
    ) -> Response:
        given = request.query_params.get("token", "")
        if request.url.path == "/" and given in tokens:
            if given == once:
                tokens.remove(once)
            opened = RedirectResponse("/", 303)
            opened.set_cookie(cookie, session, httponly=True, samesite="strict")
            return opened

        if not compare_digest(
            request.cookies.get(cookie, "").encode(), session.encode()
        ):
            return PlainTextResponse(
                "open the whole address that `scleraforce app` printed", 403
            )

        if request.method not in ("GET", "HEAD") and not holder.is_held_by(
            request.headers.get("x-tab", "")
        ):
            return PlainTextResponse(BUSY, 409)

        return await answer(request)

    @app.get("/api/look")
    def answered_frame(name: str, file: str) -> dict[str, Any]:
        answered = views.read_frame(folder.recording(name, file), file)
        result: dict[str, Any] = spelled.worded(answered)
        frames = [_operand(f"{name}/frames/{each}") for each in result["frames"]]
        return result | {"command": command_line(["read", "default", *frames])}

    def drawn_on(name: str, file: str) -> Recording:
        found, _ = views.entry(folder.recording(name, file), file)
        check_alone(found, file)
        return found

    def mask_of(found: Recording, drawn: Drawn) -> Bytes:
        return mask_between(
            drawn.outer,
            drawn.inner,
            drawn.unseen,
            *found.info.scan.shape,
        )

    @app.get("/api/state")
    def state(tab: str = "") -> dict[str, Any]:
        job = jobs[-1].as_json() | {"number": len(jobs) - 1} if jobs else None
        # what a job wrote is there
        return {
            "job": job,
            "writes": holder.is_held_by(tab),
            **folder.contents(),
        }

    @app.get("/api/recording")
    def recording(name: str) -> dict[str, Any]:
        summary: dict[str, Any] = spelled.worded(views.summary(folder.recording(name)))
        return summary

    @app.get("/api/frame")
    def frame(
        name: str, file: str, height: Annotated[int | None, Query(ge=1)] = None
    ) -> Response:
        found, entry = views.entry(folder.recording(name, file), file)
        return Response(png(found.frame(entry), height), media_type="image/png")

    @app.put("/api/draft")
    def keep(name: str, file: str, drawn: Drawn) -> dict[str, Any]:
        found = drawn_on(name, file)
        mask_of(found, drawn)
        write_draft(found, file, drawn.model_dump())
        return {}

    @app.put("/api/wall")
    def draw(name: str, file: str, drawn: Drawn) -> dict[str, Any]:
        found = drawn_on(name, file)
        with writing:
            save_wall(found, file, mask_of(found, drawn))
            remove_draft(found, file)
        return answered_frame(name, file)

    @app.delete("/api/wall")
    def erase(name: str, file: str) -> dict[str, Any]:
        found = drawn_on(name, file)
        with writing:
            remove_wall(found.path, file)
            remove_draft(found, file)
        return answered_frame(name, file)

    @app.put(UPLOAD)
    async def drop(name: str, request: Request) -> dict[str, Any]:
        chunks: AsyncIterator[bytes] = request.stream()
        await folder.upload(name, int(request.headers["content-length"]), chunks)
        return {"name": f"{SOURCES}/{name}"}

    @app.post("/api/sources")
    def described_sources(asked: Asked) -> dict[str, Any]:
        stated: dict[str, Any] = spelled.worded(sources.describe(*asked.read(folder)))
        return stated

    @app.post("/api/picture")
    def picture(asked: Asked, number: int) -> Response:
        return Response(
            sources.picture(*asked.read(folder), number), media_type="image/png"
        )

    @app.post("/api/clocks")
    def clocks(asked: Asked) -> dict[str, Any]:
        return sources.clocks(*asked.read(folder))

    @app.post("/api/words")
    def words(run: CommandRequest) -> dict[str, Any]:
        try:
            return {"command": command_line(words_of(run, folder, spelled))}
        except InputError as fault:  # the page shows it in place of the command
            return {"fault": _line(fault, folder, spelled)}

    @app.post("/api/run")
    def start(run: CommandRequest) -> dict[str, Any]:
        with writing:
            if jobs and not jobs[-1].done:
                raise InputError(
                    "another command is running; wait until it ends, or stop it"
                )

            jobs.append(
                Job.started(
                    words_of(run, folder, spelled),
                    folder.root,
                    kept(run.command),
                    spelled.flag_of("json"),
                )
            )
            return {"job": len(jobs) - 1}

    @app.delete("/api/run")
    def stop() -> dict[str, Any]:
        for job in jobs[-1:]:
            job.cancel()
        return {}

    def kept(command: str) -> Path:
        return folder.inside(f"{RESULTS}/{command}{ENDING}")

    @app.get("/api/result")
    def result(command: Literal["calibrate", "evaluate"]) -> Response:
        found = json.dumps(kept_result(kept(command)))
        return Response(found, media_type="application/json")

    @app.get("/api/csv")
    def table() -> dict[str, Any]:
        found = kept_result(kept("evaluate"))
        if found is None:
            raise InputError(
                "no result of evaluate is kept here; read the frames again"
            )
        return {"text": csv_text(found["result"]["frames"])}

    app.mount("/", StaticFiles(packages=[("scleraforce.front.app", "page")], html=True))
    longer = {UPLOAD: MOST_UPLOAD_BYTES}
    return OwnPagesOnly(EndsWithRequest(app), HOST, MOST_JSON_BYTES, longer)


def listen_locally(port: int) -> socket.socket:
    """Return the listening socket; raises `InputError` if the port is taken."""
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)

    try:
        listener.bind((HOST, port))
        listener.listen()
    except OSError as fault:
        listener.close()
        raise InputError(
            f"`port` {port}: {fault.strerror}; choose another one, or 0 for a free one"
        ) from fault

    return listener


def server_of(
    root: Path,
    listener: socket.socket,
    token: str,
    spelled: CommandWords,
    once: str = "",
) -> uvicorn.Server:
    """Return the app's server; `run([listener])` serves until Ctrl-C."""
    app = app_of(root, token, listener.getsockname()[1], spelled, once)
    return uvicorn.Server(
        uvicorn.Config(
            app,
            lifespan="off",
            log_level="critical",
            access_log=False,
            http="h11",  # which limits the headers
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=1,
        )
    )

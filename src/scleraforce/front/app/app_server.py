"""The app's web server: one page on the loopback interface, for users with the token of
its address.
"""

import json
import secrets
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from functools import lru_cache
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
from scleraforce.front.app.asked_jobs import (
    EVALUATE,
    IMPORT,
    Asked,
    CommandRequest,
    CommandWords,
    command_line,
    job_of,
    operand,
    words_of,
)
from scleraforce.front.app.job_messages import Job
from scleraforce.front.app.recording_views import (
    ReadBy,
    RecordingViews,
    mask_between,
    png,
    remove_draft,
    write_draft,
)
from scleraforce.front.app.request_end import EndsWithRequest
from scleraforce.front.app.running_jobs import RunningJob
from scleraforce.front.app.source_views import Sources
from scleraforce.front.app.work_folder import MOST_UPLOAD_BYTES, SOURCES, Folder
from scleraforce.live.console.server import OwnPagesOnly
from scleraforce.recordings.drawn_walls import remove_wall
from scleraforce.recordings.exported_files import csv_text
from scleraforce.recordings.recording_folder import Recording, check_alone
from scleraforce.records.model_folder import SHIPPED

HOST = "127.0.0.1"
RESULTS = ".scleraforce"  # folder of the last results, shown again after a reload
SILENT_S = 6.0  # after which another tab may write
UPLOAD = "/api/source"
MOST_JSON_BYTES = 4 * 2**20  # of a request, except a dropped file
DEFAULT = "default"  # the model of frames that nobody has read yet
READ = "read"
OF_ROWS = ("time_s", "scored", "covered")  # which the JSON of a frame lacks
KEPT_READINGS = 8  # of folders: of each one the inputs of its last reading
BUSY = "another tab is working in this folder; close it first"


class Drawn(BaseModel):
    """A wall: rows of its boundaries in each column, and columns that are not
    judged.
    """

    outer: list[FiniteFloat | None] = Field(max_length=16384)
    inner: list[FiniteFloat | None] = Field(max_length=16384)
    unseen: list[int] = Field(max_length=16384)


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

    text: str = spelled.worded(folder.shortened(str(fault)))
    return text


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


def judged(found: dict[str, Any]) -> dict[str, Any] | None:
    """Return a kept evaluation with what the page needs of its rows; None for one of an
    earlier version.
    """
    if "rows" not in found:
        return None
    rows = [{name: row[name] for name in OF_ROWS} for row in found["rows"]]
    return found | {"rows": rows}


def last_read(kept: Path) -> dict[str, Any] | None:
    """Return model, calibration ("": none) and recordings of the last reading; None
    without one.
    """
    try:
        found = kept.stat()
    except OSError:
        return None
    return _last_read(kept, found.st_mtime_ns, found.st_size)


@lru_cache(KEPT_READINGS)
def _last_read(kept: Path, *_: int) -> dict[str, Any] | None:
    found = kept_result(kept)
    if found is None or "rows" not in found:  # of an earlier version
        return None
    return {
        "model": found["model"],
        "calibration": found["calibration"] or "",
        "recordings": found["recordings"],
    }


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
    jobs = list[RunningJob]()
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
    def answered_frame(
        name: str, file: str, model: str = DEFAULT, calibration: str = ""
    ) -> dict[str, Any]:
        by = ReadBy(
            model if model in SHIPPED else folder.whole(model),
            folder.whole(calibration) if calibration else None,
        )
        answered = views.read_frame(folder.recording(name, file), file, by)
        result: dict[str, Any] = spelled.worded(folder.shortened(answered), READ)
        frames = [operand(f"{name}/frames/{each}") for each in result["frames"]]
        words = [READ, operand(model)]
        if calibration:
            words.append(f"{spelled.flag_of('calibration', READ)}={calibration}")
        read_by = {"model": model, "calibration": calibration}
        return result | read_by | {"command": command_line([*words, *frames])}

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
            "read": last_read(kept(EVALUATE)),
            "writes": holder.is_held_by(tab),
            **folder.contents(),
        }

    @app.get("/api/recording")
    def recording(name: str) -> dict[str, Any]:
        found = views.summary(folder.recording(name))
        summary: dict[str, Any] = spelled.worded(folder.shortened(found))
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
    def draw(
        name: str, file: str, drawn: Drawn, model: str = DEFAULT, calibration: str = ""
    ) -> dict[str, Any]:
        found = drawn_on(name, file)
        with writing:
            save_wall(found, file, mask_of(found, drawn))
            remove_draft(found, file)
        return answered_frame(name, file, model, calibration)

    @app.delete("/api/wall")
    def erase(
        name: str, file: str, model: str = DEFAULT, calibration: str = ""
    ) -> dict[str, Any]:
        found = drawn_on(name, file)
        with writing:
            remove_wall(found.path, file)
            remove_draft(found, file)
        return answered_frame(name, file, model, calibration)

    @app.put(UPLOAD)
    async def drop(name: str, request: Request) -> dict[str, Any]:
        chunks: AsyncIterator[bytes] = request.stream()
        await folder.upload(name, int(request.headers["content-length"]), chunks)
        return {"name": f"{SOURCES}/{name}"}

    @app.post("/api/sources")
    def described_sources(asked: Asked) -> dict[str, Any]:
        found = sources.describe(*asked.read(folder))
        stated: dict[str, Any] = spelled.worded(found, IMPORT)
        return stated

    @app.post("/api/picture")
    def picture(asked: Asked, number: int) -> Response:
        return Response(
            sources.picture(*asked.read(folder), number), media_type="image/png"
        )

    @app.post("/api/clocks")
    def clocks(asked: Asked) -> dict[str, Any]:
        return sources.clocks(*asked.read(folder))

    def asked_job(run: CommandRequest) -> Job:
        try:
            return job_of(run, folder)
        except InputError as fault:
            text = spelled.fault(folder.shortened(str(fault)), run.command)
            raise InputError(text) from fault

    @app.post("/api/words")
    def words(run: CommandRequest) -> dict[str, Any]:
        try:
            asked_job(run)
            return {"command": command_line(words_of(run, spelled))}
        except (InputError, ValidationError) as fault:
            # the page shows it in place of the command
            return {"fault": _line(fault, folder, spelled)}

    @app.post("/api/run")
    def start(run: CommandRequest) -> dict[str, Any]:
        with writing:
            if jobs and not jobs[-1].done:
                raise InputError(
                    "another command is running; wait until it ends, or stop it"
                )

            job = asked_job(run)
            words = words_of(run, spelled)
            place = kept(run.command)
            jobs.append(RunningJob.started(job, words, folder.root, place, spelled))
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
        found = kept_result(kept(command))
        if found is not None and command == EVALUATE:
            found = judged(found)
        return Response(json.dumps(found), media_type="application/json")

    @app.get("/api/csv")
    def table() -> dict[str, Any]:
        found = kept_result(kept(EVALUATE))
        if found is None or "rows" not in found:  # or one of an earlier version
            raise InputError(
                "no result of evaluate is kept here; read the frames again"
            )
        return {"text": csv_text(found["rows"])}

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

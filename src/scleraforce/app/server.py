"""The app's web server: one page on the loopback interface, for whoever has the token of its address."""

import getpass
import secrets
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from secrets import compare_digest
from time import monotonic
from typing import Any

import uvicorn
from fastapi import FastAPI, Request, Response
from fastapi.responses import PlainTextResponse, RedirectResponse
from fastapi.staticfiles import StaticFiles
from pydantic import BaseModel, Field

from scleraforce.app.commands import Job, shown
from scleraforce.app.folder import MOST_UPLOAD_BYTES, SOURCES, Folder
from scleraforce.app.looks import Looks, mask_between, png, remove_draft, write_draft
from scleraforce.app.sources import Sources, answers_of
from scleraforce.errors import InputError
from scleraforce.recording.export import csv_text, flat
from scleraforce.recording.sources import ImportOptions, option_name
from scleraforce.recording.walls import remove_wall, write_wall
from scleraforce.service.console.server import OwnPagesOnly

HOST = "127.0.0.1"
SILENT_S = 6.0  # after which another tab may write
WHOLE = {"bits", "gauge", "first_frame", "last_frame"}
BUSY = "another tab works in this folder; close it, or wait until it is closed"


class Asked(BaseModel):
    """Sources, and answers by the names of import's options."""

    names: list[str] = Field(max_length=20000)
    answers: dict[str, float | str | bool] = {}
    columns: list[str] = Field([], max_length=20)

    def options(self, folder: Folder) -> ImportOptions:
        """Return the options; raises `InputError`."""
        given = {name: int(value) if name in WHOLE else value for name, value in self.answers.items()}
        return answers_of(
            given | {name: folder.inside(str(given[name])) for name in {"times"} & set(given)}, self.columns
        )


class Drawn(BaseModel):
    """A wall: rows of its boundaries in each column, and columns that are not judged."""

    outer: list[float | None] = Field(max_length=16384)
    inner: list[float | None] = Field(max_length=16384)
    unseen: list[int] = Field(max_length=16384)


class Run(BaseModel):
    """A command with its operands, the name of the file or folder that it writes, and options by their names."""

    command: str
    operands: list[str] = Field(max_length=20000)
    out: str = ""
    options: dict[str, float | str | bool] = {}
    columns: list[str] = Field([], max_length=20)


OPTIONS = {
    "import": {field for field in ImportOptions.__dataclass_fields__ if field != "columns"},
    "calibrate": {"frames", "without_force", "parameters", "thickness_um", "calibration"},
    "evaluate": {"calibration", "html"},
    "export": {"answers"},
}
NEW_FILES, OLD_FILES = ("html",), ("calibration", "answers", "times")


def words_of(run: Run, folder: Folder) -> list[str]:
    """Return a command's words, checked: known options, paths inside the folder, and nothing that exists is written."""
    if run.command not in OPTIONS:
        raise InputError(f"{run.command}: no command of the app")
    models = [folder.inside(run.operands[0]).name] if run.command == "evaluate" and run.operands else []
    for name in run.operands[len(models) :] + [str(run.options[key]) for key in OLD_FILES if key in run.options]:
        if not folder.inside(name).exists():
            raise InputError(f"{name}: does not exist")
    words = [run.command, *(f"./{name}" if name.startswith("-") else name for name in run.operands)]
    for name, value in run.options.items():
        if name not in OPTIONS[run.command]:
            raise InputError(f"{name}: no option of {run.command} in the app")
        if name in NEW_FILES:
            folder.new(str(value))
        text = f"{value:g}" if isinstance(value, float) and not isinstance(value, bool) else str(value)
        words += [] if value is False else [option_name(name)] if value is True else [f"{option_name(name)}={text}"]
    words += [f"--column={column}" for column in run.columns]
    if run.command != "evaluate":
        folder.new(run.out)
        words.append(f"--out={run.out}")
    return words


@dataclass
class Holder:
    """The tab that may write: the first one that asks, until it is silent."""

    tab: str = ""
    heard_s: float = field(default=0.0)

    def is_held_by(self, tab: str) -> bool:
        """Return whether a tab may write, and note that it is there."""
        now_s = monotonic()
        if tab and (not self.tab or now_s - self.heard_s > SILENT_S):
            self.tab = tab
        if tab == self.tab:
            self.heard_s = now_s
        return bool(tab) and tab == self.tab


def app_of(root: Path, token: str, port: int) -> OwnPagesOnly:
    """Return the application for a folder: nothing is answered without the cookie that its address gives once."""
    folder, looks, sources, holder = Folder(root.resolve()), Looks(), Sources(), Holder()
    jobs: list[Job] = []
    cookie, session = f"scleraforce-{port}", secrets.token_urlsafe(32)
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @app.middleware("http")
    async def check(request: Request, answer: Callable[[Request], Awaitable[Response]]) -> Response:
        given = request.query_params.get("token", "")
        if request.url.path == "/" and given and compare_digest(given.encode(), token.encode()):
            opened = RedirectResponse("/", 303)
            opened.set_cookie(cookie, session, httponly=True, samesite="strict")
            return opened
        if not compare_digest(request.cookies.get(cookie, "").encode(), session.encode()):
            return PlainTextResponse("open the whole address that `scleraforce app` printed", 403)
        if request.method not in ("GET", "HEAD") and not holder.is_held_by(request.headers.get("x-tab", "")):
            return PlainTextResponse(BUSY, 409)
        return await answer(request)

    @app.exception_handler(InputError)
    async def refused(_: Request, fault: InputError) -> Response:
        return PlainTextResponse(str(fault).replace(f"{folder.root}/", ""), 422)

    @app.exception_handler(OSError)
    async def failed(_: Request, fault: OSError) -> Response:
        return PlainTextResponse(f"{Path(fault.filename).name if fault.filename else 'disk'}: {fault.strerror}", 422)

    @app.get("/api/state")
    def state(tab: str = "") -> dict[str, Any]:
        return {**folder.contents(), "writes": holder.is_held_by(tab), "jobs": [job.as_json() for job in jobs]}

    @app.get("/api/recording")
    def recording(name: str) -> dict[str, Any]:
        return looks.summary(folder.inside(name))

    @app.get("/api/frame")
    def frame(name: str, file: str, height: int | None = None) -> Response:
        found, entry = looks.entry(folder.inside(name), file)
        return Response(png(found.frame(entry), height), media_type="image/png")

    @app.get("/api/look")
    def look(name: str, file: str) -> dict[str, Any]:
        return looks.look(folder.inside(name), file)

    @app.put("/api/draft")
    def keep(name: str, file: str, drawn: Drawn) -> dict[str, Any]:
        found, _ = looks.entry(folder.inside(name), file)
        write_draft(found, file, drawn.model_dump())
        return {}

    @app.put("/api/wall")
    def draw(name: str, file: str, drawn: Drawn) -> dict[str, Any]:
        found, _ = looks.entry(folder.inside(name), file)
        if len(drawn.outer) != found.info.oct.columns:
            raise InputError(f"{file}: a wall of {len(drawn.outer)} columns; the frame has {found.info.oct.columns}")
        mask = mask_between(drawn.outer, drawn.inner, drawn.unseen, found.info.oct.rows)
        now = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
        write_wall(found.path, file, mask, getpass.getuser(), now)
        remove_draft(found, file)
        return looks.look(found.path, file)

    @app.delete("/api/wall")
    def erase(name: str, file: str) -> dict[str, Any]:
        found, _ = looks.entry(folder.inside(name), file)
        remove_wall(found.path, file)
        remove_draft(found, file)
        return looks.look(found.path, file)

    @app.put("/api/source")
    async def drop(name: str, request: Request) -> dict[str, Any]:
        chunks: AsyncIterator[bytes] = request.stream()
        await folder.upload(name, int(request.headers["content-length"]), chunks)
        return {"name": f"{SOURCES}/{name}"}

    @app.post("/api/sources")
    def look_at_sources(asked: Asked) -> dict[str, Any]:
        return sources.look(_inside(folder, asked.names), asked.options(folder), [*asked.answers])

    @app.post("/api/picture")
    def picture(asked: Asked, number: int) -> Response:
        return Response(
            sources.picture(_inside(folder, asked.names), asked.options(folder), number), media_type="image/png"
        )

    @app.post("/api/clocks")
    def clocks(asked: Asked) -> dict[str, Any]:
        return sources.clocks(_inside(folder, asked.names), asked.options(folder))

    @app.post("/api/words")
    def words(run: Run) -> dict[str, Any]:
        try:
            return {"command": shown(words_of(run, folder))}
        except InputError as fault:  # the page shows it in place of the command
            return {"fault": str(fault)}

    @app.post("/api/run")
    def start(run: Run) -> dict[str, Any]:
        if any(not job.done for job in jobs):
            raise InputError("a command runs already; wait for its end, or stop it")
        jobs.append(Job.started(words_of(run, folder), folder.root))
        return {"job": len(jobs) - 1}

    @app.delete("/api/run")
    def stop() -> dict[str, Any]:
        for job in jobs:
            job.cancel()
        return {}

    @app.get("/api/csv")
    def table(job: int) -> dict[str, Any]:
        if not 0 <= job < len(jobs) or not jobs[job].result:
            raise InputError(f"job {job}: has no result")
        return {"text": csv_text(map(flat, jobs[job].result["frames"]))}

    app.mount("/", StaticFiles(packages=[("scleraforce.app", "page")], html=True))
    return OwnPagesOnly(app, HOST, MOST_UPLOAD_BYTES)


def _inside(folder: Folder, names: Sequence[str]) -> list[Path]:
    return [folder.inside(name) for name in names]


def listen(port: int) -> socket.socket:
    """Return the listening socket; raises `InputError` if the port is taken."""
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen()
    except OSError as fault:
        listener.close()
        raise InputError(f"--port {port}: {fault.strerror}; choose another one, or 0 for a free one") from fault
    return listener


def server_of(root: Path, listener: socket.socket, token: str) -> uvicorn.Server:
    """Return the app's server; `run([listener])` serves until Ctrl-C."""
    app = app_of(root, token, listener.getsockname()[1])
    return uvicorn.Server(
        uvicorn.Config(
            app, lifespan="off", log_level="critical", access_log=False, server_header=False, proxy_headers=False,
            timeout_graceful_shutdown=1,
        )
    )  # fmt: skip

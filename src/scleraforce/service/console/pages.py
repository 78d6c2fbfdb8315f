"""One browser page: it gets the newest state as fast as it and the machine can take it, never a queue of old ones."""

import asyncio
import json
from dataclasses import dataclass
from time import monotonic
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect

from scleraforce.service.console.hub import Hub, PagePlace, Share

SLACK_S = 0.01  # by which a picture may come earlier than its turn, since updates have their own rhythm
MOST_UNSEEN = 4  # messages under way that the page has not acknowledged


@dataclass
class _Progress:
    """How far a page has come.

    Attributes:
        sent: number of the last message sent.
        seen: number of the last message acknowledged.
        picture: frame of the last picture sent.
        drawn: frame of the last picture that the page has drawn.
        pictured_s: when the last picture was sent.
        step: number of the last step of the history sent.
    """

    sent: int = 0
    seen: int = 0
    picture: int = 0
    drawn: int = 0
    pictured_s: float = 0.0
    step: int = 0

    @property
    def keeps_up(self) -> bool:
        """Whether the page may be sent more."""
        return self.sent - self.seen < MOST_UNSEEN


async def show(socket: WebSocket, hub: Hub, settings: dict[str, Any]) -> None:
    """Send a page all that it shows, until it leaves.

    A page answers each message with `{"seen": number}` and each picture with `{"drawn": frame}`. A page that stalls
    gets nothing until it answers, and then the newest state. If all places are taken, it may be closed for another.

    Args:
        socket: accepted already.
        hub: the connection to the monitor.
        settings: of the console, for the page.
    """
    progress, place = _Progress(), hub.enter()
    tasks: list[asyncio.Task[Any]] = []
    try:
        await socket.send_text(json.dumps({"kind": "hello", **settings}))
        tasks = [asyncio.create_task(_tell(socket, hub, progress, place))]
        tasks += [asyncio.create_task(_hear(socket, progress, place))]
        tasks += [asyncio.create_task(place.gone.wait())]
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    except WebSocketDisconnect:
        return
    finally:
        hub.pages.discard(place)
        for task in tasks:
            task.cancel()
    ends = await asyncio.gather(*tasks, return_exceptions=True)
    if any(isinstance(end, WebSocketDisconnect) for end in ends):
        return  # the page left; the other task's error follows from that
    for end in ends:
        if isinstance(end, Exception):
            raise end
    if place.gone.is_set():
        await socket.close(1013, "too many pages")
    elif ends[1] is None:  # it sent something that our page never sends
        await socket.close(1008)


async def _tell(socket: WebSocket, hub: Hub, progress: _Progress, place: PagePlace) -> None:
    while True:
        place.wake.clear()
        share = hub.thrift.share(monotonic())
        if progress.keeps_up:
            await _tell_state(socket, hub, progress, share)
            await _tell_picture(socket, hub, progress, share)
        due_s = monotonic() + share.update_s
        try:
            await asyncio.wait_for(place.wake.wait(), share.update_s)
        except TimeoutError:
            now_s = monotonic()
            hub.thrift.woke(now_s - due_s, now_s)


async def _tell_state(socket: WebSocket, hub: Hub, progress: _Progress, share: Share) -> None:
    state = hub.board.as_json(monotonic(), progress.step)
    if state["steps"]:
        progress.step = state["steps"][-1][0]  # which may still change
    progress.sent += 1
    await socket.send_text(json.dumps({**state, "thrift": share.level, "number": progress.sent}))


async def _tell_picture(socket: WebSocket, hub: Hub, progress: _Progress, share: Share) -> None:
    chosen, now_s = hub.board.picture(), monotonic()
    if chosen is None or progress.drawn != progress.picture or chosen[0] == progress.picture:
        return
    if now_s - progress.pictured_s < share.picture_s - SLACK_S:
        return
    picture = hub.pictures.of(*chosen, share.pixels)
    if picture is not None:
        progress.picture, progress.pictured_s = chosen[0], now_s
        await socket.send_bytes(picture)


async def _hear(socket: WebSocket, progress: _Progress, place: PagePlace) -> None:
    """Take a page's answers; return if it sends anything else."""
    while True:
        try:
            answer = json.loads(await socket.receive_text())
        except (ValueError, KeyError, RecursionError):  # no JSON, or no text
            return
        place.heard_s = monotonic()
        seen, drawn = (answer.get(name) if isinstance(answer, dict) else None for name in ("seen", "drawn"))
        stalled = not progress.keeps_up
        if isinstance(seen, int):
            progress.seen = max(progress.seen, min(seen, progress.sent))
        elif isinstance(drawn, int):
            progress.drawn = drawn
        else:
            return
        if stalled and progress.keeps_up:
            place.wake.set()

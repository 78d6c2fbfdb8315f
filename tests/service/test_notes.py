"""Lines for the operator come in order, and one who does not read keeps nobody waiting."""

from threading import Event

from small_monitor import FUSE_S

from scleraforce.service.notes import WAITING, Notes


def test_lines_come_in_their_order() -> None:
    lines: list[str] = []
    notes = Notes(lines.append)
    for number in range(50):
        notes(str(number))
    notes.close(FUSE_S)
    assert lines == [str(number) for number in range(50)]


def test_a_terminal_that_is_stopped_keeps_nobody_waiting_and_fills_no_memory() -> None:
    go_on, lines = Event(), list[str]()

    def write(text: str) -> None:
        go_on.wait()
        lines.append(text)

    notes = Notes(write)
    for number in range(3 * WAITING):
        notes(str(number))
    notes.close(within_s=0.01)
    assert not lines
    go_on.set()
    notes.close(FUSE_S)
    assert WAITING <= len(lines) <= WAITING + 1

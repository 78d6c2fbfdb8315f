"""The benchmark's mutated messages, a fiftieth of them."""

import pytest

from bench_openigtlink import run
from scleraforce.openigtlink import Decoder

KINDS = {"Image", "Query", "Sensor", "Status", "Text", "Transform"}
WITHOUT_A_MESSAGE = {"Unknown", "BadChecksum", "Malformed", "Broken", "frame", "part kept", "image refused"}


@pytest.mark.slow
def test_mutated_messages_give_events_and_no_exception() -> None:
    outcome = run(20_000, seed=2)
    assert outcome.unexpected == []
    assert set(outcome.events) == {f"Received {kind}" for kind in KINDS} | WITHOUT_A_MESSAGE
    assert min(outcome.events.values()) >= 100


def test_the_same_seed_gives_the_same_messages_and_an_exception_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(300, seed=4).events == run(300, seed=4).events != run(300, seed=5).events

    def fails(self: Decoder) -> None:
        raise IndexError(len(self._head))

    monkeypatch.setattr(Decoder, "_end", fails)
    outcome = run(300, seed=4)
    assert "IndexError" in outcome.unexpected[0]

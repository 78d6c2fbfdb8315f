"""The eye that a monitor learns: from frames that teach alone, forgotten after a puncture, saved and resumed."""

from dataclasses import replace
from pathlib import Path
from select import select
from time import monotonic, sleep

import pytest
from analytic_frames import KNOWN, LIBRARY, SCALE, STUDY, image, tip_of, wall_section
from small_models import write_fixed_reader
from waiting import FUSE_S

from scleraforce.errors import InputError
from scleraforce.known import Modulus
from scleraforce.service import messages
from scleraforce.service.channel import Child
from scleraforce.service.frame_ring import FrameRing
from scleraforce.service.learning import LEARNED_FILE, SETTLES_S, resumed

pytest.importorskip("torch")

assert KNOWN.modulus is not None
PRIOR = Modulus(mean_pa=1.15 * KNOWN.modulus.mean_pa, sd_pa=0.25 * KNOWN.modulus.mean_pa, source="population")
EYE = replace(KNOWN, modulus=PRIOR)


class Learning:
    """A second opinion that learns, and its frames."""

    def __init__(self, folder: Path) -> None:
        model, self.record = folder / "reader", folder / "session"
        write_fixed_reader(model, LIBRARY, [float(number == 20) for number in range(64)])
        self.record.mkdir()
        self.ring, self.number = FrameRing.create(4, STUDY.oct.rows, STUDY.oct.columns), 0
        settings = messages.OpinionSettings(
            model=model, known=EYE, scale=SCALE, ring=self.ring.place, learns="eye-a", record=self.record
        )
        self.child = Child("scleraforce.service.second_opinion", settings, [self.ring.place.descriptor])
        assert self.hear(messages.Alive)

    def show(self, force_n: float, teaches: bool = True, pierced: bool = False) -> list[messages.CompanionMessage]:
        """Show a frame; return what came until its opinion, with it."""
        self.number += 1
        self.ring.put(self.number, image(wall_section(tip_of(force_n)), self.number))
        self.child.channel.send(
            messages.OpinionAsked(
                number=self.number, order=self.number, at_s=monotonic(), teaches=teaches, pierced=pierced
            )
        )
        return self.hear(messages.OpinionGiven)

    def hear(self, kind: type[messages.CompanionMessage]) -> list[messages.CompanionMessage]:
        """Return what comes until a message of a kind."""
        heard = list[messages.CompanionMessage]()
        while not any(isinstance(one, kind) for one in heard):
            assert select([self.child.channel], [], [], FUSE_S)[0], heard
            heard += self.child.channel.receive()
        return heard

    def learned(self, within_s: float, teaches: bool = True) -> messages.EyeLearned | None:
        """Hold the needle until something was learned; None if nothing was within a time."""
        end_s = monotonic() + within_s
        while monotonic() < end_s:
            for one in self.show(0.020, teaches):
                if isinstance(one, messages.EyeLearned):
                    return one
            sleep(0.05)
        return None


def test_frames_that_teach_move_e_a_puncture_takes_it_back_and_a_session_can_be_resumed(tmp_path: Path) -> None:
    learning = Learning(tmp_path)
    learning.show(0.010, teaches=False)
    assert learning.learned(3 * SETTLES_S, teaches=False) is None
    for force_n in (0.005, 0.010, 0.015, 0.020):
        learning.show(force_n)
        sleep(0.11)
    found = learning.learned(FUSE_S)
    assert found is not None
    assert found.fault == ""
    assert found.frames >= 1
    modulus = found.known.modulus
    assert modulus is not None
    assert modulus.source == "shape"
    assert modulus.relative_sd == pytest.approx(PRIOR.relative_sd, rel=0.05)  # one shallow dent tells little
    again = resumed(EYE, learning.record / LEARNED_FILE, "eye-a")
    assert again.modulus is not None
    assert again.modulus.source == "population"
    assert again.modulus.sd_pa == pytest.approx(PRIOR.sd_pa, rel=0.1)
    with pytest.raises(InputError, match="not of eye-b"):
        resumed(EYE, learning.record / LEARNED_FILE, "eye-b")
    with pytest.raises(InputError, match=r"learned at 2\.0 mmHg"):
        resumed(replace(EYE, iop_pa=2000.0), learning.record / LEARNED_FILE, "eye-a")
    with pytest.raises(InputError, match="stiffening: 0; that of this eye is 10"):
        resumed(replace(EYE, stiffening=10.0), learning.record / LEARNED_FILE, "eye-a")
    learning.show(0.020, teaches=False, pierced=True)
    forgotten = learning.learned(FUSE_S, teaches=False)
    assert forgotten is not None
    assert forgotten.frames == 0
    assert forgotten.known.modulus == PRIOR
    assert learning.child.end(FUSE_S) == 0

"""A second opinion in its process, without a monitor."""

from pathlib import Path
from select import select
from time import monotonic

from analytic_frames import SCALE, STUDY, image, tip_of, wall_section
from waiting import FUSE_S, wait_until

from scleraforce.live.companions import process_messages
from scleraforce.live.companions.eye_learning import LEAST_S
from scleraforce.live.companions.process_channel import Child
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.records.scan import PixelScale, Plane
from scleraforce.records.setup import Setup

# since which the frames that teach came: none has to wait until it has settled
LONG_AGO_S = 600.0


class OpinionProcess:
    """The process, and the ring that it reads from; with a `record` it learns the eye,
    and saves it there.
    """

    def __init__(
        self,
        model: Path,
        setup: Setup,
        record: Path | None = None,
        planes: tuple[Plane, ...] = (),
        scale: PixelScale = SCALE,
    ) -> None:
        self.ring = FrameRing.create(4, STUDY.oct.rows, STUDY.oct.columns)
        self.number = 0
        self.at_s = monotonic() - LONG_AGO_S
        settings = process_messages.OpinionSettings(
            model=model,
            setup=setup,
            scale=scale,
            ring=self.ring.place,
            learns=record and "eye-a",
            record=record,
            planes=planes,
        )
        self.child = Child(
            "scleraforce.live.companions.second_opinion",
            settings,
            [self.ring.place.descriptor],
        )

    def ask(
        self,
        number: int,
        order: int,
        at_s: float = 0.0,
        teaches: bool = False,
        pierced: bool = False,
        planes: tuple[tuple[str, int, int], ...] = (),
    ) -> None:
        asked = process_messages.OpinionAsked(
            number=number,
            order=order,
            at_s=at_s,
            teaches=teaches,
            pierced=pierced,
            planes=planes,
        )
        assert self.child.channel.send(asked)

    def hear(
        self, kind: type[process_messages.CompanionMessage]
    ) -> list[process_messages.CompanionMessage]:
        """Return what comes until a message of a kind, which is the last."""
        heard = list[process_messages.CompanionMessage]()
        while not any(isinstance(one, kind) for one in heard):
            assert select([self.child.channel], [], [], FUSE_S)[0], heard
            heard += self.child.channel.receive(1)
        return heard

    def opinion(self) -> process_messages.OpinionGiven:
        (message,) = self.hear(process_messages.OpinionGiven)
        return message

    def show(
        self, force_n: float, teaches: bool = True, pierced: bool = False
    ) -> list[process_messages.CompanionMessage]:
        """Show a frame, long enough after the last one to teach; return what came until
        its opinion, with it.
        """
        self.number += 1
        self.at_s += 1.1 * LEAST_S
        self.ring.put(self.number, image(wall_section(tip_of(force_n)), self.number))
        self.ask(self.number, self.number, self.at_s, teaches, pierced)
        return self.hear(process_messages.OpinionGiven)

    def learned(self, teaches: bool = True) -> process_messages.EyeLearned:
        """Hold the needle until something was learned."""
        found = list[process_messages.EyeLearned]()
        wait_until(
            lambda: (
                found.extend(
                    one
                    for one in self.show(0.020, teaches)
                    if isinstance(one, process_messages.EyeLearned)
                )
                or bool(found)
            )
        )
        return found[0]

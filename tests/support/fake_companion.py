"""A companion of the monitor without a process."""

from scleraforce.service.companions.channel import Channel
from scleraforce.service.companions.messages import CompanionMessage


class FakeCompanion:
    """In place of a `Child`: `theirs` is its end of the channel."""

    def __init__(self) -> None:
        self.channel, self.theirs = Channel.pair()

    def says(self, message: CompanionMessage) -> None:
        assert self.theirs.send(message)

    def end(self) -> None:
        self.channel.close()
        self.theirs.close()

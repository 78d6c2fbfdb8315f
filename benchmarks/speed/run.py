"""Settings of a run, for every part."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from scleraforce.records.study import Study, read_study

ROOT = Path(__file__).parents[2]
QUICK_STUDY = Path(__file__).with_name("quick.toml")


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        quick: at reduced sizes.
        folder: shared results of the parts: data set, library, recording.
        training: train the reader to the end.
    """

    quick: bool
    folder: Path
    training: bool = False

    def count(self, usual: int, quick: int) -> int:
        """Return how often, or how large."""
        return quick if self.quick else usual

    @property
    def study(self) -> Study:
        """The paper's study; a very small one where it is quick."""
        return read_study(QUICK_STUDY) if self.quick else Study()


def in_turns(
    work: Mapping[str, Callable[[], object]], rounds: int
) -> dict[str, list[float]]:
    """Do each piece of work once a round; return its times, s."""
    taken: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(rounds):
        for name, do in work.items():
            start = perf_counter()
            do()
            taken[name].append(perf_counter() - start)

    return taken

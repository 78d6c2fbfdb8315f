"""Training the reader on the study's library: to the end, or a stated part of it."""

from dataclasses import dataclass, field, replace
from time import perf_counter

from scleraforce.library.library_store import build_library, open_library
from scleraforce.records.study import ReaderStudy
from speed.parts.axisymmetric import LIBRARY
from speed.record import Row, Table
from speed.run import Run

GOAL_S = 180.0
INTERVALS_GOAL_S = 60.0
# of the part
EPOCHS = 3
EYES = 12
SETTINGS = """`train --kind reader` of the paper's study on its library, which is there
already: epochs of samples that are drawn beside, half of them mirror images, then the
virtual eyes that intervals are measured on. Nothing else trains such a reader."""


@dataclass
class Course:
    """When a training began, when each epoch and each eye was done, and when it ended,
    s.
    """

    began_s: float
    epochs_s: list[float] = field(default_factory=list)
    eyes_s: list[float] = field(default_factory=list)
    ended_s: float = 0.0

    @property
    def epoch_s(self) -> float:
        """Seconds of an epoch."""
        return _each(self.epochs_s)

    @property
    def eye_s(self) -> float:
        """Seconds of an eye."""
        return _each(self.eyes_s)

    def whole_s(self, reader: ReaderStudy) -> float:
        """Return what the training to the end would take: what is done once, before,
        between and after epochs and eyes, counts once.

        >>> from scleraforce.records.study import Study
        >>> small = replace(Study().reader, epochs=10, interval_eyes=4)
        >>> Course(0.0, [3.0, 5.0, 7.0], [10.0, 11.0], 12.0).whole_s(small)
        28.0
        """
        more_epochs = reader.epochs - len(self.epochs_s)
        more_eyes = reader.interval_eyes - len(self.eyes_s)
        taken_s = self.ended_s - self.began_s
        return taken_s + more_epochs * self.epoch_s + more_eyes * self.eye_s


def measure(run: Run) -> Table:
    """Train the reader."""
    from scleraforce.lab.training.trained_models import train_reader

    study = run.study
    reader = study.reader
    eyes = reader.interval_eyes
    library = run.folder / LIBRARY
    if not library.exists():
        build_library(study, library)

    part = replace(reader, epochs=EPOCHS, interval_eyes=min(EYES, eyes))
    course = Course(perf_counter())
    trained = train_reader(
        open_library(library),
        study if run.training else replace(study, reader=part),
        run.folder / "reader",
        progress=lambda _: course.epochs_s.append(perf_counter()),
        measured=lambda _: course.eyes_s.append(perf_counter()),
    )
    course.ended_s = perf_counter()
    more = {"an epoch, s": course.epoch_s, "an eye, s": course.eye_s}
    done = f"estimated from {len(course.epochs_s)} epochs and {len(course.eyes_s)} eyes"
    words = f"{done}; --training does all"
    if run.training:
        more["right class, %"] = 100.0 * trained["metrics"]["validation_accuracy"]
        words = "done to the end"

    sizes = f"{reader.epochs} epochs of {reader.samples_per_epoch:,} samples"
    whole = Row(
        what="the reader, default training",
        value=course.whole_s(reader),
        unit="s",
        goal=GOAL_S,
        settings=f"{sizes}, {eyes} eyes: {words}",
        more=more,
    )
    intervals = Row(
        what=f"intervals of {eyes} virtual eyes",
        value=eyes * course.eye_s,
        unit="s",
        goal=INTERVALS_GOAL_S,
        settings=f"a part of the training above: of {len(course.eyes_s)} eyes",
    )

    return Table("Training the reader", SETTINGS, (whole, intervals))


def _each(marks_s: list[float]) -> float:
    """Return the time of one, the first left out: processes start before it."""
    return (marks_s[-1] - marks_s[0]) / (len(marks_s) - 1)

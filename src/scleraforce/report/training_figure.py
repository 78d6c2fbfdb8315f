"""Training: loss and accuracy over the epochs (the paper's Fig. 8a)."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter

from scleraforce.report.style import BLUE, RED, inches, styled


@styled
def draw_training_curves(
    training_loss: Sequence[float],
    validation_loss: Sequence[float],
    training_accuracy: Sequence[float],
    validation_accuracy: Sequence[float],
) -> Figure:
    """Draw loss (logarithmic) and accuracy over the epochs; each sequence has one value an epoch.

    The training figures are those under dropout, which is why validation lies above training.
    """
    figure = Figure(figsize=inches(170, 60))
    left, right = figure.subplots(1, 2)
    epochs = range(1, len(training_loss) + 1)
    for axes, training, validation, name in (
        (left, training_loss, validation_loss, "cross-entropy"),
        (right, training_accuracy, validation_accuracy, "accuracy"),
    ):
        axes.plot(epochs, training, color=RED, linestyle=(0, (4, 2)), marker="s", markersize=2.5, label="training")
        axes.plot(epochs, validation, color=BLUE, marker="o", markersize=2.5, label="validation")
        axes.set_xlabel("epoch")
        axes.set_ylabel(name)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    left.set_yscale("log")
    left.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    left.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    left.yaxis.set_minor_formatter(NullFormatter())
    right.legend(loc="lower right")
    return figure

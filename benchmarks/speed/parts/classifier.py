"""Training on the paper's data set: our classifier, and scikit-learn's as one would
call it.
"""

from time import perf_counter

import numpy as np

from scleraforce.lab.training.slice_dataset import open_dataset
from speed.parts.dataset import made_dataset
from speed.record import Row, Table
from speed.run import Run

OURS = "our classifier"
PEER = "scikit-learn's `MLPClassifier`"
MOST_EPOCHS = 40  # of scikit-learn's; it stops earlier where nothing improves
SETTINGS = """The paper's data set, split by contacts; both see the training slices and
are asked for the classes of the others. Two cores; each once, one after the other: a
training takes as long as it takes."""


def measure(run: Run) -> Table:
    """Train both."""
    from sklearn.neural_network import MLPClassifier  # type: ignore[import-untyped]  # comes without types

    from scleraforce.lab.training.classifier_training import (
        CLASSIFIER_THREADS,
        fit_classifier,
    )
    from scleraforce.lab.training.trained_models import split_samples

    dataset = open_dataset(made_dataset(run))
    network = dataset.study.network
    training, unseen = split_samples(dataset, dataset.youngs_modulus_pa)
    start = perf_counter()
    fitted = fit_classifier(network, training, unseen)
    ours_s = perf_counter() - start
    inputs, asked = (
        (part.pixels > 0).astype(np.float32) for part in (training, unseen)
    )
    peer = MLPClassifier(
        network.hidden,
        early_stopping=True,
        max_iter=run.count(MOST_EPOCHS, 12),
        random_state=0,
    )
    start = perf_counter()
    peer.fit(inputs, training.target)
    peer_s = perf_counter() - start
    sizes = "-".join(map(str, network.hidden))

    return Table(
        "Training a classifier",
        SETTINGS,
        (
            Row(
                what=OURS,
                value=ours_s,
                unit="s",
                beside=PEER,
                beside_value=peer_s,
                settings=(
                    f"{sizes}, dropout {network.dropout:g}, {network.dropout_masks}"
                    f" masks, mirrored slices; {CLASSIFIER_THREADS} threads of PyTorch,"
                    " its validation after each epoch included"
                ),
                more={
                    "right class, %": 100.0 * fitted.curves.validation_accuracy[-1],
                    "epochs": float(network.epochs),
                },
            ),
            Row(
                what=PEER,
                value=peer_s,
                unit="s",
                settings=(
                    f"{sizes}, default settings (Adam, batches of 200), but"
                    f" `early_stopping`, and {MOST_EPOCHS} epochs at most"
                ),
                more={
                    "right class, %": 100.0 * float(peer.score(asked, unseen.target)),
                    "epochs": float(peer.n_iter_),
                },
            ),
        ),
    )

"""The plan of a data set: what every sample is, before anything is simulated (paper sec. 2.3, 3.3)."""

from dataclasses import dataclass, fields
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.study import Choice, DatasetGroup, Sampled, Study

UNIT_IMAGES = 200  # about this many samples are simulated and stored together
DRAWS = ("force", "gap", "tilt", "direction", "framing_lateral", "framing_depth")


@dataclass(frozen=True)
class DatasetPlan:
    """Every sample's metadata, each of shape (samples,); the samples of a contact stand together.

    `contact` numbers the contacts through all groups. `validation` marks the samples of the contacts that training
    never sees. `seed` reproduces a sample's own draws (see `sample_draws`).
    """

    force_n: NDArray[np.float64]
    target: NDArray[np.uint8]
    thickness_m: NDArray[np.float64]
    contact: NDArray[np.int32]
    polar_rad: NDArray[np.float64]
    azimuth_rad: NDArray[np.float64]
    gap_m: NDArray[np.float64]
    tilt_rad: NDArray[np.float64]
    direction_rad: NDArray[np.float64]
    framing_lateral_m: NDArray[np.float64]
    framing_depth_m: NDArray[np.float64]
    validation: NDArray[np.bool_]
    seed: NDArray[np.uint32]
    unit_images: int  # samples of a unit of work, which is a chunk of the store

    @property
    def images(self) -> int:
        """Number of samples."""
        return len(self.force_n)

    @property
    def units(self) -> int:
        """Number of units of work; the last may be smaller."""
        return -(-self.images // self.unit_images)

    @property
    def columns(self) -> dict[str, NDArray[np.generic]]:
        """The metadata by name."""
        return {item.name: getattr(self, item.name) for item in fields(self) if item.name != "unit_images"}

    def unit(self, number: int) -> slice:
        """Return the samples of a unit of work."""
        return slice(number * self.unit_images, min((number + 1) * self.unit_images, self.images))


def plan_dataset(study: Study) -> DatasetPlan:
    """Draw the samples that a study asks for; the same study gives the same plan.

    For each group: `contacts` random contacts (fewer where there are fewer images), of which `validation_fraction`,
    but at least one, is kept for validation; the polar angle is drawn from the needle's range (uniform in angle), the
    azimuth uniformly around the eye. The images are spread evenly over the contacts. Each sample draws its own
    force, uniform from 0 to the group's largest, and its own gap, tilt, direction and framing.

    Args:
        study: the study; `[dataset]`, `[needle]` and `[classes]` matter here.

    Returns:
        The plan, in the order of groups, contacts, samples.

    >>> plan_dataset(Study()).images
    19200
    """
    draft = draft_plan(study)
    return draft.samples(slice(0, draft.images))


@dataclass(frozen=True)
class PlanDraft:
    """A plan without what each sample draws for itself: it is made fast, and gives any part of the plan."""

    study: Study
    groups: "tuple[_GroupDraft, ...]"

    @property
    def images(self) -> int:
        """Number of samples."""
        return sum(len(group.seed) for group in self.groups)

    def unit(self, number: int) -> DatasetPlan:
        """Return the plan of the samples of a unit of work alone, numbered from 0."""
        size = unit_images(self.study)
        return self.samples(slice(number * size, min((number + 1) * size, self.images)))

    def samples(self, samples: slice) -> DatasetPlan:
        """Return the plan of consecutive samples alone, numbered from 0."""
        parts, first = [], 0
        for group in self.groups:
            count = len(group.seed)
            low, high = max(samples.start - first, 0), min(samples.stop - first, count)
            if low < high:
                parts.append(group.plan(self.study, slice(low, high)))
            first += count
        joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return DatasetPlan(unit_images=unit_images(self.study), **joined)


def draft_plan(study: Study) -> PlanDraft:
    """Draw the contacts of a plan and the seeds of its samples."""
    rng = np.random.default_rng(study.dataset.seed)
    groups = study.dataset.group
    first_contact = np.cumsum([0, *(_contacts(study, group) for group in groups)])
    drafts = (_draft_group(study, group, int(first), rng) for group, first in zip(groups, first_contact, strict=False))
    return PlanDraft(study, tuple(drafts))


def sample_draws(seed: NDArray[np.uint32]) -> dict[str, NDArray[np.float64]]:
    """Return the uniform draws in [0, 1) of samples with these seeds, each of shape (samples,), by `DRAWS` name."""
    uniform = np.array([np.random.default_rng(number).random(len(DRAWS)) for number in seed])
    return dict(zip(DRAWS, uniform.reshape(-1, len(DRAWS)).T, strict=True))


@dataclass(frozen=True)
class _GroupDraft:
    """A group: its contacts, numbered from `first_contact` and each with the number of its samples, and all seeds."""

    group: DatasetGroup
    first_contact: int
    polar_rad: NDArray[np.float64]
    azimuth_rad: NDArray[np.float64]
    validation: NDArray[np.bool_]
    spread: NDArray[np.intp]
    seed: NDArray[np.uint32]

    def plan(self, study: Study, samples: slice) -> dict[str, Any]:
        """Return the columns of consecutive samples."""
        seed, group = self.seed[samples], self.group
        numbers = np.arange(samples.start, samples.stop)
        contact = np.searchsorted(np.cumsum(self.spread), numbers, side="right")
        draws = sample_draws(seed)
        gap = study.dataset.gap_m
        force_n = group.max_force_n * draws["force"]
        return {
            "force_n": force_n,
            "target": np.array([study.classes.classify(force) for force in force_n], dtype=np.uint8),
            "thickness_m": np.full(len(seed), group.thickness_m),
            "contact": (self.first_contact + contact).astype(np.int32),
            "polar_rad": self.polar_rad[contact],
            "azimuth_rad": self.azimuth_rad[contact],
            "gap_m": np.full(len(seed), study.needle.gap_m) if gap is None else _at(gap, draws["gap"]),
            "tilt_rad": _at(study.dataset.tilt_rad, draws["tilt"]),
            "direction_rad": _at(study.dataset.direction_rad, draws["direction"]),
            "framing_lateral_m": _at(study.dataset.framing_lateral_m, draws["framing_lateral"]),
            "framing_depth_m": _at(study.dataset.framing_depth_m, draws["framing_depth"]),
            "validation": self.validation[contact],
            "seed": seed,
        }


def _draft_group(study: Study, group: DatasetGroup, first: int, rng: np.random.Generator) -> _GroupDraft:
    contacts = _contacts(study, group)
    return _GroupDraft(
        group,
        first,
        polar_rad=study.needle.polar_angle_rad.sample(rng, contacts),
        azimuth_rad=rng.uniform(0.0, 2.0 * np.pi, contacts),
        validation=_validation_contacts(study, contacts, rng),
        spread=_spread(group.images, contacts),
        seed=rng.integers(0, 2**32, group.images, dtype=np.uint32),
    )


def _at(sampled: Sampled, uniform: NDArray[np.float64]) -> NDArray[np.float64]:
    """Map draws in [0, 1) to a sampled value: all of its choices are equally likely, or its range is uniform."""
    if isinstance(sampled, Choice):
        values = np.asarray(sampled.values, dtype=np.float64)
        return values[(uniform * len(values)).astype(np.intp)]
    return sampled.min + (sampled.max - sampled.min) * uniform


def _contacts(study: Study, group: DatasetGroup) -> int:
    return min(study.dataset.contacts, group.images)


def _validation_contacts(study: Study, contacts: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Choose the contacts of the validation set; both sets get at least one where there are two."""
    wanted = round(study.dataset.validation_fraction * contacts)
    count = min(max(wanted, 1), contacts - 1)
    return rng.permutation(np.arange(contacts) < count)


def _spread(images: int, contacts: int) -> NDArray[np.intp]:
    """Return the images of each contact: equal, but for one more on the first few where they do not divide."""
    return images // contacts + (np.arange(contacts) < images % contacts)


def unit_images(study: Study) -> int:
    """Return the samples in a unit: whole contacts in every group where a common multiple near `UNIT_IMAGES` exists."""
    even = [group.images // _contacts(study, group) for group in study.dataset.group]
    whole = lcm(*even)
    return whole * max(1, round(UNIT_IMAGES / whole)) if whole <= 2 * UNIT_IMAGES else UNIT_IMAGES

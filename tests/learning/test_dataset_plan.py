from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from scleraforce.learning.dataset import DatasetPlan, draft_plan, plan_dataset
from scleraforce.study import Choice, DatasetGroup, Range, Study


def with_dataset(**changes):
    study = Study()
    return replace(study, dataset=replace(study.dataset, **changes))


@pytest.fixture(scope="module")
def paper():
    return plan_dataset(Study())


def test_the_papers_study_gives_its_19200_images(paper):
    thickness, counts = np.unique(paper.thickness_m, return_counts=True)
    np.testing.assert_allclose(thickness, [4e-4, 5e-4, 6e-4, 7e-4, 8e-4])
    assert counts.tolist() == [3200, 4000, 4000, 4000, 4000]
    assert paper.images == 19200


def test_every_thickness_has_200_contacts_of_its_own(paper):
    for thickness in np.unique(paper.thickness_m):
        assert len(np.unique(paper.contact[paper.thickness_m == thickness])) == 200
    assert len(np.unique(paper.contact)) == 1000
    assert np.all(np.diff(paper.contact) >= 0)


def test_training_and_validation_share_no_contact_and_validation_has_a_tenth_of_each_thickness(paper):
    assert not set(paper.contact[paper.validation]) & set(paper.contact[~paper.validation])
    for thickness in np.unique(paper.thickness_m):
        assert paper.validation[paper.thickness_m == thickness].mean() == pytest.approx(0.1)


def test_forces_are_uniform_up_to_the_largest_of_their_group(paper):
    for thickness, largest in [(4e-4, 45e-3), (5e-4, 60e-3), (8e-4, 60e-3)]:
        force = paper.force_n[np.isclose(paper.thickness_m, thickness)]
        assert stats.kstest(force / largest, "uniform").pvalue > 0.01


def test_contacts_lie_in_the_needles_range_all_around_the_eye(paper):
    _, first = np.unique(paper.contact, return_index=True)
    polar = (np.rad2deg(paper.polar_rad[first]) - 25.0) / 20.0
    assert stats.kstest(polar, "uniform").pvalue > 0.01
    assert stats.kstest(paper.azimuth_rad[first] / (2 * np.pi), "uniform").pvalue > 0.01


def test_targets_are_the_classes_of_the_forces(paper):
    expected = np.where(paper.force_n < 5e-3, 0, np.where(paper.force_n > 30e-3, 2, 1))
    np.testing.assert_array_equal(paper.target, expected)


def test_a_seed_gives_one_plan_and_another_seed_another():
    group = (DatasetGroup(images=400),)
    first, again, other = (plan_dataset(with_dataset(seed=seed, group=group)) for seed in (3, 3, 4))
    for name, values in first.columns.items():
        np.testing.assert_array_equal(values, again.columns[name])
    assert np.any(first.force_n != other.force_n)
    assert np.any(first.azimuth_rad != other.azimuth_rad)


def test_closed_ranges_leave_one_gap_and_one_framing(paper):
    for name in ("tilt_rad", "direction_rad", "framing_lateral_m", "framing_depth_m"):
        assert not np.any(paper.columns[name])
    assert set(paper.gap_m) == {0.5e-3}


def test_open_ranges_are_drawn_for_each_sample_and_independently():
    plan = plan_dataset(
        with_dataset(
            gap_m=Range(min=0.35e-3, max=1e-3),
            tilt_rad=Range(min=-0.1, max=0.1),
            direction_rad=Choice((0.0, 1.0)),
            framing_lateral_m=Range(min=-1e-3, max=1e-3),
            framing_depth_m=Range(min=-2e-4, max=2e-4),
        )
    )
    assert stats.kstest((plan.gap_m - 0.35e-3) / 0.65e-3, "uniform").pvalue > 0.01
    assert stats.kstest((plan.framing_lateral_m + 1e-3) / 2e-3, "uniform").pvalue > 0.01
    assert np.mean(plan.direction_rad == 1.0) == pytest.approx(0.5, abs=0.02)
    drawn = np.stack(
        [plan.force_n / plan.force_n.max(), plan.gap_m, plan.tilt_rad, plan.framing_lateral_m, plan.framing_depth_m]
    )
    correlation = np.corrcoef(drawn) - np.eye(len(drawn))
    assert np.abs(correlation).max() < 0.04


def test_a_samples_seed_reproduces_its_draws(paper):
    for sample in (0, 5000, 19199):
        force = np.random.default_rng(paper.seed[sample]).random()
        largest = 45e-3 if sample < 3200 else 60e-3
        assert paper.force_n[sample] == force * largest


def test_images_that_do_not_divide_are_spread_evenly():
    plan = plan_dataset(with_dataset(contacts=7, group=(DatasetGroup(images=45), DatasetGroup(images=3))))
    counts = np.bincount(plan.contact)
    assert counts[:7].tolist() == [7, 7, 7, 6, 6, 6, 6]
    assert counts[7:].tolist() == [1, 1, 1]
    for group in (plan.contact < 7, plan.contact >= 7):
        assert 0 < plan.validation[group].sum() < group.sum()


@pytest.mark.parametrize(("contacts", "images", "whole"), [(200, 4000, True), (10, 100, True), (2, 10_000, False)])
def test_units_cover_every_sample_once_and_hold_whole_contacts_where_that_is_possible(contacts, images, whole):
    plan = plan_dataset(with_dataset(contacts=contacts, group=(DatasetGroup(images=images),)))
    covered = np.concatenate([np.arange(plan.images)[plan.unit(unit)] for unit in range(plan.units)])
    np.testing.assert_array_equal(covered, np.arange(plan.images))
    starts = np.flatnonzero(np.diff(plan.contact, prepend=-1))
    assert whole == all(plan.unit(unit).start in starts for unit in range(plan.units))


def test_the_papers_units_do_not_split_a_contact(paper: DatasetPlan):
    starts = set(np.flatnonzero(np.diff(paper.contact, prepend=-1)))
    assert all(paper.unit(unit).start in starts for unit in range(paper.units))


def test_a_part_of_a_plan_is_that_of_the_whole_whatever_groups_and_contacts_it_splits():
    study = with_dataset(
        contacts=7,
        gap_m=Range(min=0.4e-3, max=0.9e-3),
        group=(DatasetGroup(images=45), DatasetGroup(images=3), DatasetGroup(images=230, thickness_m=8e-4)),
    )
    whole, draft = plan_dataset(study), draft_plan(study)
    assert draft.images == whole.images == 278
    for part in (slice(0, 1), slice(40, 60), slice(45, 48), slice(277, 278)):
        for name, values in draft.samples(part).columns.items():
            np.testing.assert_array_equal(values, whole.columns[name][part], err_msg=name)
    units = [draft.unit(number) for number in range(whole.units)]
    assert len(units) > 1
    np.testing.assert_array_equal(np.concatenate([unit.seed for unit in units]), whole.seed)

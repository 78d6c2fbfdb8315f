"""The framing that a network must tolerate to read what the virtual laboratory images."""

from dataclasses import replace

from scleraforce.study import Range, Study


def framed_for_laboratory(study: Study) -> Study:
    """Open the data set's framing ranges to where the study's virtual laboratory may put the eye.

    The paper proposes it as its next step (sec. 4, "randomly cropping each simulated image"). A pixel of the slice is
    left on every side: the unloaded wall of the data set is pressurised, which lifts it by up to that much.

    >>> framed_for_laboratory(Study()).dataset.framing_lateral_m
    Range(min=-0.0003, max=0.0003)
    """
    shift, surface, room = study.phantom.eye_shift_m.bounds, study.phantom.surface_depth_m.bounds, study.slice.pixel_m
    depth = [surface[side] + shift[side] - study.slice.margin_m for side in (0, 1)]
    dataset = replace(
        study.dataset,
        framing_lateral_m=_rounded(shift[0] - room, shift[1] + room),
        framing_depth_m=_rounded(depth[0] - room, depth[1] + room),
    )
    return replace(study, dataset=dataset)


def _rounded(low_m: float, high_m: float) -> Range:
    """Return a range free of the last bits' rounding, so that its TOML reads back to the same."""
    return Range(min=round(low_m, 9), max=round(high_m, 9))

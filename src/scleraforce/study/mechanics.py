"""The `[mechanics]` section of a study: how the virtual eyes of `simulate` and `phantom` bend."""

from dataclasses import dataclass

from scleraforce.study.fields import check_fields, option


@dataclass(frozen=True)
class MechanicsStudy:
    """Linear mechanics, or finite strain on the mesh graded towards the contact.

    `follower`, for finite strain: the pressure stays normal to the wall as it bends; false: it keeps its first
    direction and size at every node.
    """

    kind: str = option("linear", "linear", "finite-strain")
    follower: bool = True

    def __post_init__(self) -> None:
        check_fields(self)

"""What this project does otherwise than the paper, and why; the page lists all of it."""

from dataclasses import dataclass

__all__ = ["DEVIATIONS", "Deviation"]


@dataclass(frozen=True)
class Deviation:
    """One deviation: what it is about, how the paper has it, how it is here, and the reason."""

    topic: str
    paper: str
    here: str
    reason: str


DEVIATIONS = (
    Deviation(
        "recordings",
        "five ex vivo porcine eyes, a robot and an OCT device",
        "five virtual eyes in the same design: frames are rendered, force logs are computed",
        "the paper's data are not public; the mechanics of the virtual eyes is the one that the network learned from, "
        "so the accuracy shows that the chain works, not what it reaches on tissue",
    ),
    Deviation(
        "forces of the trials",
        "as the robot's steps of 0.5 and 1 mm gave them; many lie near a bound",
        "spread evenly over each class, 2 mN clear of its bounds",
        "the paper gives counts, not forces; the label of a frame is itself uncertain by about 1 mN",
    ),
    Deviation(
        "Young's modulus of eye 5",
        "not estimated",
        "0.25 MPa, the mean of the others",
        "the paper reads it with that value too",
    ),
    Deviation(
        "contact",
        "one place near the limbus for each eye",
        "polar angles spread over the study's range (25 to 45 degrees from the pole)",
        "the paper gives no angles",
    ),
    Deviation(
        "gap of the B-scan",
        "as close to the needle as possible, considered in the simulation",
        "0.5 mm, in the recordings and in the simulation",
        "the paper gives no figure",
    ),
    Deviation(
        "framing of the slices",
        "not described; random cropping is proposed as a next step (sec. 4)",
        "drawn for each slice from the range in which the virtual laboratory puts its eyes",
        "an eye that lies 0.2 mm higher looks like a smaller force to a network that knows one framing only",
    ),
    Deviation(
        "Kalman filter",
        "two sigma points on E itself; the noise of an observation is not given",
        "two sigma points on the logarithm of E, which keeps it positive; noise from the segmentation and the pixel; "
        "outlying points are left out",
        "a study may ask for E itself (calibration.positive = false)",
    ),
    Deviation(
        "registration",
        "rigid; how is not described",
        "shift and rotation are estimated together with the modulus, from all points of the frame",
        "at high forces the whole arc moves, so neither the far wall nor the dent is a fixed reference",
    ),
    Deviation(
        "eyes that are read",
        "with a mean modulus that was found on four of them",
        "the same, and once more with each eye left out of the mean",
        "an eye should not take part in its own model",
    ),
    Deviation(
        "elements",
        "14,643 'hexahedral elements' (trilinear; that is the node count of 9,600 of them)",
        "curved 27-node hexahedra, one layer",
        "they lock in bending: at the paper's size they are 8 to 33 % too stiff; a study may ask for them",
    ),
    Deviation(
        "needle",
        "a local force in a small region",
        "a pressure patch of the needle's outer diameter (0.7 mm), its resultant exactly the force",
        "the region's size decides how deep the contact itself sinks in",
    ),
    Deviation(
        "intraocular pressure",
        "surface area times pressure, normal to the surface",
        "a consistent surface load on the inner surface of the elements",
        "the same, without the error of lumping",
    ),
    Deviation(
        "gravity",
        "along -y",
        "along the axis of the half-sphere, into its base",
        "the same, in other axes",
    ),
    Deviation(
        "repeated solves",
        "the inverse of K is stored",
        "K is factored once for a thickness; each solution scales with force and with 1/E",
        "an inverse is dense: slower, larger and less accurate",
    ),
    Deviation(
        "slices",
        "contour detection and threshold of a rendered cut",
        "the exact intersection of the curved elements with the plane, filled by the winding number",
        "a pixel is wall exactly where its centre lies in the wall",
    ),
    Deviation(
        "split",
        "90 % of the images to train, 10 % to validate",
        "90 % and 10 % of the contacts: no contact is in both",
        "two images of one contact differ little, and would flatter the validation",
    ),
    Deviation(
        "training",
        "gradient descent in TensorFlow and Keras; rate, batch and schedule are not given",
        "in PyTorch: momentum 0.9, warm-up, a cosine schedule, clipped gradients",
        "plain descent under a dropout of 0.8 stalls",
    ),
    Deviation(
        "filtering of frames",
        "filtered to look like the simulated images; not described",
        "boundaries of the wall are found in the raw frame, with a verdict whether it can be judged",
        "a frame that cannot be judged counts as class 2 (withdraw), never as harmless",
    ),
    Deviation(
        "names in Table 3",
        "the row-wise figure is called precision, the column-wise one recall",
        "recall is row-wise, precision column-wise, with Wilson intervals",
        "these are the standard names",
    ),
)

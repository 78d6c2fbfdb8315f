"""What the paper reports, and where this method deviates from it."""

from dataclasses import KW_ONLY, dataclass

PAPER_TITLE = "Mendizabal, Sznitman, Cotin: Force classification during robotic interventions (2020)"


@dataclass(frozen=True)
class PaperEye:
    """One eye of the paper: wall thickness and trials in each class (Table 1), Young's modulus (Table 2)."""

    name: str
    _: KW_ONLY
    thickness_m: float
    trials: tuple[int, int, int]
    modulus_pa: float | None
    modulus_sd_pa: float | None


EYES = (
    PaperEye("eye 1", thickness_m=800e-6, trials=(0, 11, 14), modulus_pa=0.27e6, modulus_sd_pa=4.7e3),
    PaperEye("eye 2", thickness_m=500e-6, trials=(1, 2, 2), modulus_pa=0.22e6, modulus_sd_pa=6.7e3),
    PaperEye("eye 3", thickness_m=650e-6, trials=(2, 0, 3), modulus_pa=0.24e6, modulus_sd_pa=3.9e3),
    PaperEye("eye 4", thickness_m=560e-6, trials=(2, 1, 2), modulus_pa=0.29e6, modulus_sd_pa=4.9e3),
    PaperEye("eye 5", thickness_m=800e-6, trials=(2, 1, 2), modulus_pa=None, modulus_sd_pa=None),
)

MEAN_MODULUS_PA = 0.25e6  # sec. 3.2, for all eyes

CONFUSION = ((5, 2, 0), (0, 14, 1), (0, 0, 23))  # Table 3, rows are targets

SECONDS_A_SLICE = 0.47  # sec. 3.3: 19,200 images in two and a half hours


@dataclass(frozen=True)
class Deviation:
    """One deviation: its topic, what the paper does, what we do, and why."""

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
        "spread evenly over each class; no trial lies within 2 mN of a bound of its class",
        "the paper gives counts, not forces, and the label of a frame is uncertain by about 1 mN; so the accuracy says "
        "nothing of forces at a bound, which are the hardest to classify",
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
        "iterated filter",
        "no iteration is described",
        "each correction is repeated about its own posterior until it settles, at most 10 times",
        "the prior is wide and the displacement goes as 1/E: a single correction trusts the slope between two distant "
        "sigma points too much; calibration.iterations = 1 is the paper's filter",
    ),
    Deviation(
        "registration",
        "rigid; how is not described",
        "shift, depth and rotation are fitted together with a modulus of the frame's own, from both boundaries",
        "at high forces the whole arc moves, so neither the far wall nor the dent is a fixed reference",
    ),
    Deviation(
        "pose in the filter",
        "registered first, then taken as known",
        "the filter linearises at the fitted pose and marginalises pose and offset of the inner boundary over their "
        "prior: both enter the noise of the observation",
        "the same points would otherwise serve twice, for the pose and for E, and the posterior would be too narrow",
    ),
    Deviation(
        "errors that all frames share",
        "not mentioned",
        "zero and drift of the force sensor, the contact angle and the model's own error are consider parameters: they "
        "widen the posterior of E and are not estimated",
        "more frames do not average out an error that they share",
    ),
    Deviation(
        "frames of low force",
        "all frames are assimilated",
        "frames of at most 5 mN (calibration.min_force_mn) inform the pose only",
        "their dent is shallow and says little of E, and an error of the force weighs most there",
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
        "contours (OpenCV's findContours) and threshold of a cut through the mesh",
        "the exact intersection of the curved elements with the plane, filled by the winding number, then OpenCV's "
        "threshold; findContours is not used",
        "a pixel is wall exactly where its centre lies in the wall, and the section's contour is known already",
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
        "dropout masks",
        "not described; ordinary dropout draws one mask a sample",
        "four dropout masks a sample and step (network.dropout_masks), and the mean of their losses",
        "they make the gradient less noisy under a dropout of 0.8, at little cost",
    ),
    Deviation(
        "mirroring",
        "not described",
        "a random half of each batch is mirrored left to right (network.mirror)",
        "a mirrored slice is the same B-scan plane seen from behind, of the same force",
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

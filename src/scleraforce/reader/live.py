"""The reading in the control loop: the answer to a frame within a millisecond or two.

The network alone answers, with every verdict that needs no fit to the response library; that fit takes some times as
long and gives its opinion afterwards, in a process of its own (`Reader.read`, `service.companions.second_opinion`).
"""

from scleraforce.known.eye import Known
from scleraforce.reader.answers import LiveReading
from scleraforce.reader.reader import Reader
from scleraforce.reader.warming import warming_frame
from scleraforce.recording.pixels import Pixels, PixelScale

WARMING_FRAMES = 20


class LiveReader:
    """Reads the frames of one eye, one after the other.

    Some frames are read at the start, so that the first real one takes no longer than the others.

    Args:
        reader: the model. A classifier's answer is its own; of a reader it is that of its network.
        known: of the eye; a classifier takes no notice of it.
        refractive_index: by which depth is stretched in the frames; 1 where the scanner has corrected it.
    """

    def __init__(self, reader: Reader, known: Known, refractive_index: float) -> None:
        self._reader, self._known, self._refractive_index = reader, known, refractive_index
        scanner, scale = reader.study.oct, PixelScale.of(reader.study.oct)
        frame = warming_frame((scanner.rows, scanner.columns), scale, reader.study.eye.radius_m, known.thickness_m)
        for _ in range(WARMING_FRAMES):
            self.read(frame, scale)

    def read(self, frame: Pixels, scale: PixelScale) -> LiveReading:
        """Read one raw frame.

        Args:
            frame: raw B-scan (row, column).
            scale: size of a pixel as stored; its refractive index is not looked at, the scanner's counts.

        Returns:
            The reading; `can_calibrate` of its answer is False, as it is not asked in the loop.
        """
        scale = PixelScale(lateral_m=scale.lateral_m, depth_m=scale.depth_m, refractive_index=self._refractive_index)
        return self._reader.read_live(frame, scale, self._known)

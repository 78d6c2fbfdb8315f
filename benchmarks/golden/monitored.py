"""The monitor as a command of its own, whose second opinions are copied to a file:
FILE, then the monitor's words.
"""

import runpy
import sys
from pathlib import Path

from golden.hooks import tap_opinions

COMMAND = Path(sys.executable).with_name("scleraforce")

if __name__ == "__main__":
    tap_opinions(Path(sys.argv[1]))
    sys.argv = [str(COMMAND), "monitor", *sys.argv[2:]]
    runpy.run_path(str(COMMAND), run_name="__main__")

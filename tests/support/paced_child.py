"""The monitor of `sf.monitor` on the time of its frames (`paced_monitor`)."""

import paced_monitor  # noqa: F401 - slows the monitor's parts

from scleraforce.front.api.monitor_child import main

if __name__ == "__main__":
    main()

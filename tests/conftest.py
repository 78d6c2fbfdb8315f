"""What all tests share."""

import signal

# A shell without job control starts background jobs with SIGINT ignored, and children inherit that: the tests that send
# Ctrl-C to a child would wait for ever where CI runs that way.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

"""A server written with pyigtl, as its examples are: it takes images and answers each
with a string.

    python -m speed.pyigtl_echo

It prints its port, and ends with its standard input.
"""

import sys
from threading import Thread
from time import sleep

import pyigtl  # type: ignore[import-untyped]  # comes without types

REST_S = 1e-3  # between two looks at what has come


def serve() -> None:
    """Answer until standard input ends."""
    server = pyigtl.OpenIGTLinkServer(port=0, local_server=True)
    print(server.server_address[1], flush=True)
    Thread(target=_answer, args=(server,), daemon=True).start()
    sys.stdin.read()


def _answer(server: pyigtl.OpenIGTLinkServer) -> None:
    while True:
        for message in server.get_latest_messages():
            server.send_message(
                pyigtl.StringMessage("1", device_name=message.device_name), wait=False
            )
        sleep(REST_S)


if __name__ == "__main__":
    serve()

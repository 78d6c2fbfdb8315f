"""Where nobody can listen one line says so, and names the option."""

import re
import socket

import pytest

from scleraforce.errors import InputError
from scleraforce.service.startup import listen


@pytest.mark.parametrize("host", ["", " ", "no-such-host.invalid", "x" * 64 + ".example", "203.0.113.7", "a\nb"])
def test_a_host_that_is_no_address_of_this_machine_is_refused_in_one_line(host: str) -> None:
    with pytest.raises(InputError) as refused:
        listen(host, 0)
    assert str(refused.value).startswith(f"--host {host!r}" if host.strip() else "--host: empty")
    assert "\n" not in str(refused.value)


def test_a_port_that_is_taken_is_named_with_its_option() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        words = f"127.0.0.1:{port}: Address already in use; give another --web-port, or end what listens there"
        with pytest.raises(InputError, match=f"^{re.escape(words)}$"):
            listen("127.0.0.1", port, "web-")


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="this machine has no IPv6")
def test_an_address_of_ipv6_is_listened_on() -> None:
    with listen("::1", 0) as listener, socket.create_connection(listener.getsockname()[:2]):
        pass

"""When the console shows less, and when more again."""

from itertools import pairwise

import pytest

from scleraforce.service.console.hub import SHARES, Thrift


def late(thrift: Thrift, times: int, begin_s: float) -> None:
    for n in range(times):
        thrift.woke(0.05, begin_s + 0.1 * n)


def test_each_share_is_less_than_the_one_before_and_none_is_so_slow_that_a_page_calls_it_not_live() -> None:
    for more, less in pairwise(SHARES):
        assert less.update_s > more.update_s
        assert less.picture_s > more.picture_s
        assert less.pixels <= more.pixels
    assert [share.level for share in SHARES] == [0, 1, 2]
    assert SHARES[-1].update_s + 0.2 < 0.5  # SILENT_MS of link.js
    assert SHARES[-1].picture_s + SHARES[-1].update_s <= 0.7  # STALE_MS of scan.js


def test_while_the_machine_is_in_time_all_is_shown() -> None:
    thrift = Thrift()
    for n in range(1000):
        thrift.woke(0.003, 0.03 * n)
        thrift.answered(2.4, 0, 0.03 * n)
        assert thrift.share(0.03 * n).level == 0


@pytest.mark.parametrize("sign", ["late", "slow", "behind"])
def test_three_signs_within_a_second_are_less_and_two_are_not(sign: str) -> None:
    def give(thrift: Thrift, n: int, at_s: float) -> None:
        if sign == "late":
            thrift.woke(0.02, at_s)
        else:
            thrift.answered(12.0 if sign == "slow" else 2.4, n if sign == "behind" else 0, at_s)

    short, rare = Thrift(), Thrift()
    for n in range(1, 4):
        give(short, n, 10.0 + 0.4 * n)
        give(rare, n, 10.0 + 0.6 * n)
        assert rare.share(10.0 + 0.6 * n).level == 0
    assert short.share(11.2).level == 1


def test_frames_that_were_overtaken_once_are_one_sign_however_often_they_are_told() -> None:
    thrift = Thrift()
    for n in range(50):
        thrift.answered(2.4, 5, 10.0 + 0.01 * n)
    assert thrift.share(10.5).level == 0


def test_it_goes_down_a_level_a_second_at_most_and_comes_back_only_after_calm() -> None:
    thrift = Thrift()
    late(thrift, 3, 10.0)
    assert thrift.share(10.2).level == 1
    late(thrift, 3, 10.3)
    assert thrift.share(10.6).level == 1
    late(thrift, 3, 11.0)
    assert thrift.share(11.3).level == 2
    late(thrift, 20, 11.4)
    assert thrift.share(13.4).level == 2
    assert thrift.share(18.2).level == 2
    assert thrift.share(18.4).level == 1
    assert thrift.share(18.5).level == 1
    assert thrift.share(23.5).level == 0

"""Where requests may go on somebody's word: every block of the IANA's registries, at its edges."""

from __future__ import annotations

import ipaddress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.domain.outbound import Address, may_send_to, parse_networks


def _blocks(text: str) -> list[str]:
    return text.split()


# As the registries list them, block by block, whether or not a larger block holds one.
IPV4 = _blocks(
    """
    0.0.0.0/8 0.0.0.0/32 10.0.0.0/8 100.64.0.0/10 127.0.0.0/8 169.254.0.0/16 172.16.0.0/12 192.0.0.0/24
    192.0.0.0/29 192.0.0.8/32 192.0.0.9/32 192.0.0.10/32 192.0.0.170/32 192.0.0.171/32 192.0.2.0/24
    192.31.196.0/24 192.52.193.0/24 192.88.99.0/24 192.88.99.2/32 192.168.0.0/16 192.175.48.0/24
    198.18.0.0/15 198.51.100.0/24 203.0.113.0/24 240.0.0.0/4 255.255.255.255/32 224.0.0.0/4 224.0.0.0/24
    232.0.0.0/8 233.252.0.0/24 239.0.0.0/8
    """
)
IPV6 = _blocks(
    """
    ::1/128 ::/128 ::ffff:0:0/120 64:ff9b:1::/48 100::/64 100:0:0:1::/64 2001::/23 2001::/32
    2001:1::1/128 2001:1::2/128 2001:1::3/128 2001:2::/48 2001:3::/32 2001:4:112::/48 2001:10::/28
    2001:20::/28 2001:30::/28 2001:db8::/32 2002::/16 2620:4f:8000::/48 3fff::/20 5f00::/16 fc00::/7
    fe80::/10 fec0::/10 ff00::/8 ff02::/16 ff0e::/16 ::/8 100::/8 200::/7 400::/6 800::/5 1000::/4
    4000::/3 6000::/3 8000::/3 a000::/3 c000::/3 e000::/4 f000::/5 f800::/6 fe00::/9
    """
)
# Blocks that touch no other: the address before the first and the one behind the last are public.
ALONE = _blocks(
    """
    10.0.0.0/8 100.64.0.0/10 169.254.0.0/16 172.16.0.0/12 192.0.0.0/24 192.0.2.0/24 192.31.196.0/24
    192.52.193.0/24 192.88.99.0/24 192.168.0.0/16 192.175.48.0/24 198.18.0.0/15 198.51.100.0/24
    203.0.113.0/24 2001:db8::/32 2002::/16 2620:4f:8000::/48
    """
)


def is_public(address: Address | str) -> bool:
    return may_send_to(ipaddress.ip_address(address), allowed=())


@pytest.mark.parametrize("block", [*IPV4, *IPV6])
def test_no_block_with_a_special_end_is_sent_to(block: str) -> None:
    network = ipaddress.ip_network(block)
    middle = network[network.num_addresses // 2]
    if block == "::/8":  # holds 64:ff9b::/96 and ::ffff:0:0/96, which are judged as IPv4
        assert not is_public(network[0])
        return
    assert [is_public(one) for one in (network[0], network[-1], middle)] == [False, False, False]


@pytest.mark.parametrize("block", ALONE)
def test_what_lies_beside_such_a_block_is_public(block: str) -> None:
    network = ipaddress.ip_network(block)
    assert is_public(network[0] - 1)
    assert is_public(network[-1] + 1)


@pytest.mark.parametrize(
    ("inside", "outside"),
    [
        ("0.255.255.255", "1.0.0.0"),
        ("127.0.0.0", "126.255.255.255"),
        ("127.255.255.255", "128.0.0.0"),
        ("224.0.0.0", "223.255.255.255"),
        ("2001:1ff:ffff:ffff:ffff:ffff:ffff:ffff", "2001:200::"),
        ("2001::", "2000:ffff:ffff:ffff:ffff:ffff:ffff:ffff"),
        ("3fff::", "3ffe:ffff:ffff:ffff:ffff:ffff:ffff:ffff"),
        ("3fff:fff:ffff:ffff:ffff:ffff:ffff:ffff", "3fff:1000::"),
        ("1fff:ffff:ffff:ffff:ffff:ffff:ffff:ffff", "2000::"),
        ("4000::", "3fff:ffff:ffff:ffff:ffff:ffff:ffff:ffff"),
    ],
)
def test_blocks_that_touch_others_end_where_they_say(inside: str, outside: str) -> None:
    assert abs(int(ipaddress.ip_address(inside)) - int(ipaddress.ip_address(outside))) == 1
    assert [is_public(inside), is_public(outside)] == [False, True]


@given(st.integers(0, 2**32 - 1))
def test_what_python_knows_as_not_global_is_not_sent_to(number: int) -> None:
    address = ipaddress.IPv4Address(number)
    assert address.is_global or not is_public(address)
    for written in (f"::ffff:{address}", f"64:ff9b::{address}"):
        assert is_public(written) == is_public(address)
    for relay in (_six_to_four(number), _teredo(number)):
        assert not is_public(relay)


@given(st.integers(0, 2**128 - 1))
def test_what_python_knows_as_not_global_of_ipv6_is_not_sent_to(number: int) -> None:
    address = ipaddress.IPv6Address(number)
    assert not is_public(address) or (
        address.is_global
        and not (address.is_multicast or address.is_reserved or address.is_site_local)
        and number >> 125 == 1
    )


@pytest.mark.parametrize("hidden", ["127.0.0.1", "10.1.2.3", "169.254.169.254", "192.0.0.8", "0.0.0.0"])  # noqa: S104
def test_no_notation_hides_an_address(hidden: str) -> None:
    number = int(ipaddress.IPv4Address(hidden))
    written = [
        f"::ffff:{hidden}",
        f"::{hidden}",
        f"::ffff:0:{hidden}",
        f"64:ff9b::{hidden}",
        f"64:ff9b:1::{hidden}",
        _six_to_four(number),
        _teredo(number),
        f"fe80::5efe:{hidden}%eth0",
    ]
    assert [is_public(one) for one in written] == [False] * len(written)


def test_what_an_operator_allows_is_sent_to_in_every_notation_of_ipv4() -> None:
    allowed = parse_networks("10.1.0.0/16, fd00::/8")
    sent_to = [
        "10.1.0.0",
        "10.1.255.255",
        "::ffff:10.1.2.3",
        "64:ff9b::10.1.2.3",
        "fd00::",
        "fdff::1",
        "1.1.1.1",
    ]
    not_sent_to = ["10.0.255.255", "10.2.0.0", "::ffff:10.2.0.0", "2002:a01:203::", "fc00::1", "fe00::"]
    for one in sent_to:
        assert may_send_to(ipaddress.ip_address(one), allowed=allowed), one
    for one in not_sent_to:
        assert not may_send_to(ipaddress.ip_address(one), allowed=allowed), one


def _six_to_four(number: int) -> Address:
    return ipaddress.IPv6Address(0x2002 << 112 | number << 80 | 1)


def _teredo(number: int) -> Address:
    server = int(ipaddress.IPv4Address("65.54.227.120"))
    return ipaddress.IPv6Address(0x20010000 << 96 | server << 64 | (number ^ 0xFFFF_FFFF))

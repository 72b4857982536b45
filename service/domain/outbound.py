"""Which addresses the product may send requests to on somebody's word: public ones, and those allowed."""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Network = ipaddress.IPv4Network | ipaddress.IPv6Network

_PUBLIC_UNICAST = (ipaddress.ip_network("0.0.0.0/0"), ipaddress.ip_network("2000::/3"))
"""Where public addresses lie at all: of IPv6, the IANA has given out 2000::/3 alone (IANA IPv6 Address
Space registry; RFC 4291, section 2.4), so what it keeps or gives out for other ends is left out unnamed:
fc00::/7, fe80::/10, the site-local fec0::/10, ff00::/8, 5f00::/16, 100::/64, ::/8 and the rest."""

SPECIAL_PURPOSE = tuple(
    ipaddress.ip_network(block)
    for block in (
        # IANA IPv4 Special-Purpose Address registry, every block, the reachable anycast ones included:
        # who answers there is a router or a relay nearby, and no receiver of anybody's
        "0.0.0.0/8",  # this network: RFC 791, section 3.2
        "10.0.0.0/8",  # private use: RFC 1918
        "100.64.0.0/10",  # shared by a carrier's customers: RFC 6598
        "127.0.0.0/8",  # loopback: RFC 1122, section 3.2.1.3
        "169.254.0.0/16",  # link-local: RFC 3927
        "172.16.0.0/12",  # private use: RFC 1918
        "192.0.0.0/24",  # protocol assignments: RFC 6890, section 2.1; with 192.0.0.8 of RFC 7600
        "192.0.2.0/24",  # documentation: RFC 5737
        "192.31.196.0/24",  # AS112: RFC 7535
        "192.52.193.0/24",  # AMT: RFC 7450
        "192.88.99.0/24",  # relays of 6to4 and 6a44: RFC 7526, RFC 6751
        "192.168.0.0/16",  # private use: RFC 1918
        "192.175.48.0/24",  # AS112: RFC 7534
        "198.18.0.0/15",  # benchmarking: RFC 2544
        "198.51.100.0/24",  # documentation: RFC 5737
        "203.0.113.0/24",  # documentation: RFC 5737
        "240.0.0.0/4",  # reserved: RFC 1112, section 4; with 255.255.255.255 of RFC 8190
        # IANA IPv4 Address Space registry
        "224.0.0.0/4",  # multicast: RFC 5771
        # IANA IPv6 Special-Purpose Address registry, as far as it lies in 2000::/3
        "2001::/23",  # protocol assignments: RFC 2928; with Teredo, benchmarking, ORCHID, AMT, AS112, DRIP
        "2001:db8::/32",  # documentation: RFC 3849
        "2002::/16",  # 6to4: RFC 3056
        "2620:4f:8000::/48",  # AS112: RFC 7534
        "3fff::/20",  # documentation: RFC 9637
    )
)
"""Blocks that are set aside for another end than being somebody's address on the internet."""

_STANDS_FOR_IPV4 = (
    ipaddress.IPv6Network("::ffff:0:0/96"),  # IPv4-mapped: RFC 4291, section 2.5.5.2
    ipaddress.IPv6Network("64:ff9b::/96"),  # NAT64, where a network has no IPv4: RFC 6052, section 2.1
)


def parse_networks(text: str) -> tuple[Network, ...]:
    """Return the networks of a comma-separated list such as ``10.0.0.0/8, fd00::/8``.

    Raises
    ------
    ValueError
        If one of them is none; the sentence names it.
    """
    return tuple(ipaddress.ip_network(part.strip()) for part in text.split(",") if part.strip())


def may_send_to(address: Address, *, allowed: Sequence[Network]) -> bool:
    """Return whether requests may go to an address: it lies in an allowed network, or is a public one.

    Public is what the IANA gives out as unicast addresses of the internet, less what its registries set
    aside for special ends. An address of IPv6 that only writes one of IPv4 is judged as that one; one of a
    tunnel (6to4, Teredo) is not public, wherever the tunnel leads.
    """
    plain = _plain(address)
    return _in_any(plain, allowed) or (
        _in_any(plain, _PUBLIC_UNICAST) and not _in_any(plain, SPECIAL_PURPOSE)
    )


def _in_any(address: Address, networks: Sequence[Network]) -> bool:
    return any(address.version == network.version and address in network for network in networks)


def _plain(address: Address) -> Address:
    """Return the IPv4 address that an IPv6 address stands for, if it does."""
    if any(address in network for network in _STANDS_FOR_IPV4):
        return ipaddress.IPv4Address(int(address) & 0xFFFF_FFFF)
    return address

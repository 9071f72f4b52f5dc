"""Tell the address by which visitors are limited."""

import ipaddress

_SUBSCRIBER = 64  # bits of an IPv6 address that one subscriber does not choose


def subscriber(host: str) -> str:
    """Return the address that limits count: an IPv4 address, or the network of an IPv6 address."""
    address = ipaddress.ip_address(host.partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is not None:  # a visitor by IPv4 of a socket for both
            return str(address.ipv4_mapped)
        return str(ipaddress.ip_network((address, _SUBSCRIBER), strict=False))
    return str(address)

"""The addresses of this machine that other computers can open."""

from __future__ import annotations

import ipaddress
import re
from pathlib import Path

FIB_TRIE = Path("/proc/net/fib_trie")
IF_INET6 = Path("/proc/net/if_inet6")


def machine_addresses() -> tuple[str, ...]:
    """Return this machine's addresses but for loopback and link-local ones, as Linux lists them."""
    return addresses_in(_text(FIB_TRIE), _text(IF_INET6))


def addresses_in(fib_trie: str, if_inet6: str) -> tuple[str, ...]:
    """Return the addresses in the kernel's two tables, IPv4 first, each once."""
    found = re.findall(r"\|-- (\S+)\s+/32 host LOCAL", fib_trie)
    found += [":".join(re.findall("....", line.split()[0])) for line in if_inet6.splitlines() if line.strip()]
    addresses = (ipaddress.ip_address(text) for text in dict.fromkeys(found))
    return tuple(str(each) for each in addresses if not (each.is_loopback or each.is_link_local))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""

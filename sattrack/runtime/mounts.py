"""Which mount is meant: what `--mount`, or the settings, say."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, TypeAlias

from sattrack.core.errors import BadInputError
from sattrack.mount.alpaca.link import AlpacaAddress, parse_alpaca
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.client import Address, parse_address

if TYPE_CHECKING:
    from sattrack.runtime.owner import Owner

MountAddress: TypeAlias = Address | AlpacaAddress
"""Where a real mount is; `runtime.links.open_link` opens the way there, the same for all kinds."""
FORMS = "xerxes://HOST:PORT?listen=PORT or alpaca://HOST:PORT/DEVICE"


def is_antenna(url: str | None) -> bool:
    """Tell whether `--mount` names an antenna's controller."""
    return url is not None and url.partition(":")[0] == "antenna"


def mount_address(url: str | None) -> MountAddress | None:
    """Read `--mount`: None for the simulated mount. Raises BadInputError."""
    if url is None:
        raise BadInputError(
            f"no mount: give --mount {FORMS}, or set [mount] url in sattrack.toml; "
            "--mount sim is a simulated one for practice"
        )
    scheme = url.partition(":")[0]
    if url == "sim":
        return None
    if is_antenna(url):
        raise BadInputError(f"--mount {url}: an antenna's controller is driven by `sattrack track` alone")
    if scheme == "alpaca":
        return parse_alpaca(url)
    if scheme != "xerxes":
        raise BadInputError(f"--mount {url}: write sim, {FORMS}")
    return parse_address(url)


def owned_address(owner: Owner) -> MountAddress:
    """Return where the mount is that a session on this machine owns."""
    if owner.mount.startswith("alpaca:"):
        return parse_alpaca(owner.mount)
    host, _, port = owner.mount.rpartition(":")
    return Address(host, int(port), owner.listen_port)


def usual_profile(url: str | None) -> MountProfile:
    """Return what is presumed of a mount of this kind without a profile; a wrong URL is of no kind."""
    if url is not None and url.startswith("alpaca:"):
        with contextlib.suppress(BadInputError):
            return parse_alpaca(url).usual_profile()
    return MountProfile()

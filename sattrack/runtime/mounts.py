"""Which mount is meant: what `--mount`, or the settings, say."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.errors import BadInputError
from sattrack.xerxes.client import parse_address

if TYPE_CHECKING:
    from sattrack.xerxes.client import Address

NOT_YET = ("alpaca",)


def is_antenna(url: str | None) -> bool:
    """Tell whether `--mount` names an antenna's controller."""
    return url is not None and url.partition(":")[0] == "antenna"


def mount_address(url: str | None) -> Address | None:
    """Read `--mount`: None for the simulated mount. Raises BadInputError."""
    if url is None:
        raise BadInputError(
            "no mount: give --mount xerxes://HOST:PORT?listen=PORT or set [mount] url in sattrack.toml; "
            "--mount sim is a simulated one for practice"
        )
    scheme = url.partition(":")[0]
    if url == "sim":
        return None
    if is_antenna(url):
        raise BadInputError(f"--mount {url}: an antenna's controller is driven by `sattrack track` alone")
    if scheme in NOT_YET:
        raise BadInputError(f"--mount {url}: {scheme} mounts are not supported yet; use xerxes:// or sim")
    if scheme != "xerxes":
        raise BadInputError(f"--mount {url}: write sim or xerxes://HOST:PORT?listen=PORT")
    return parse_address(url)

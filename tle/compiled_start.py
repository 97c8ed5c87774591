"""Whether the search may run compiled, and getting ready for it: what numba cannot do here costs one line."""

from __future__ import annotations

from importlib.util import find_spec

from tle.errors import TleError

# Objects times hours above which loading machine code is sooner outweighed than it takes.
_WORTH = 400_000.0


class NoCompilerError(TleError):
    """numba is missing, or does not work here: broken, too old, or not made for this numpy."""


def numba_is_there() -> bool:
    """Tell whether numba is there to compile with; it is not imported for this."""
    return find_spec("numba") is not None


def is_worth_compiling(objects: int, hours: float) -> bool:
    """Tell whether numba is there, and a search large enough to outweigh loading what it compiled."""
    return objects * hours >= _WORTH and numba_is_there()


def is_compiled() -> bool:
    """Tell whether machine code is kept already; where it is not, `prepare` takes some ten seconds."""
    from importlib.metadata import PackageNotFoundError

    from tle.compiled_cache import is_complete

    try:
        return is_complete()
    except PackageNotFoundError:
        return False


def prepare() -> None:
    """Compile all of the search, or load it where that was done before; a second call costs nothing.

    Raises NoCompilerError where that cannot be.
    """
    try:
        from tle import compiled_warmup
        from tle.compiled_cache import mark_complete

        compiled_warmup.run()
        mark_complete()
    except Exception as error:  # a foreign compiler, in whatever state: it fails with whatever it likes
        told = " ".join(str(error).split())[:160]
        raise NoCompilerError(
            f"numba does not work here ({type(error).__name__}: {told}): "
            "pip install -U numba, or uninstall it to do without"
        ) from error

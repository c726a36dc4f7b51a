"""Access token of the view: who presents it may watch a run and stop it."""

import secrets

# 192 random bits, 32 characters in the address, all of which may stand in a header.
BYTES = 24


def new_token() -> str:
    """A new random token, for one run or one replay."""
    return secrets.token_urlsafe(BYTES)


def is_token(given: str, token: str) -> bool:
    """Compares in constant time, so that timing does not reveal how much of a guess is right."""
    return secrets.compare_digest(given.encode(), token.encode())

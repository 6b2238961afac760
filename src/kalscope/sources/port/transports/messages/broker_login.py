"""The password of a broker: never in an address, which is shown, recorded and shared."""

from __future__ import annotations

import netrc
import os

from kalscope.errors import BadDevice

PASSWORD_VARIABLE = "KALSCOPE_MQTT_PASSWORD"
"""The environment variable that holds it."""
WHERE = f"set {PASSWORD_VARIABLE}, or write `machine HOST login USER password …` into ~/.netrc"
"""Where users put a password, for messages."""


def password_of(host: str, user: str) -> str | None:
    """The password of a user at a broker: from the environment, else from ~/.netrc; None where there is none.

    Raises:
        BadDevice: ~/.netrc cannot be read, or others can read it.
    """
    given = os.environ.get(PASSWORD_VARIABLE)
    if given is not None:
        return given
    try:
        found = netrc.netrc().hosts.get(host)  # an entry `default` is for any host: never sent
    except FileNotFoundError:
        return None
    except (netrc.NetrcParseError, OSError, UnicodeError) as error:
        # Nothing of its message is repeated: it may quote a password.
        raise BadDevice(
            f"~/.netrc must be readable for you alone, and hold `machine HOST login USER password …`"
            f" (got {type(error).__name__}): chmod 600 ~/.netrc, or set {PASSWORD_VARIABLE}"
        ) from None
    return found[2] if found is not None and found[0] == user else None

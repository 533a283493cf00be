"""``[console]``: where the page is served, to whom, and how much a browser may send."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

_LOCAL_NAMES = frozenset({"localhost"})


@dataclass(frozen=True, slots=True)
class Settings:
    """Who may see the page, and how it is fed.

    Attributes:
        host: address that it listens at. Anything but this machine's loopback needs ``token_file``.
        port: TCP port.
        token_file: file with the token that a browser must know, 16 characters or more, readable by its owner alone;
            a relative path begins at the robot's TOML file. Empty: none is asked for.
        certificate: PEM file of the certificate (and those that signed it) by which it is served over TLS, with
            ``private_key``; empty: without.
        private_key: PEM file of its key.
        origins: pages of other origins that may use this console, as ``https://ops.example``; its own always may.
        backgrounds: folder of images, and of folders of tiles ``z/x/y.png``, to lay under the map; a relative path
            begins at the robot's TOML file. Empty: ``console/backgrounds`` in the robot's own folder.
        image_rate: pictures of the camera a second, while somebody watches.
        image_quality: quality of these JPEG pictures, 1 to 100.
        speed: fastest that the page's joystick drives, m/s.
        turn_rate: fastest that it turns, rad/s.
    """

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=1, le=65535)] = 8180
    token_file: str = ""
    certificate: str = ""
    private_key: str = ""
    origins: tuple[str, ...] = ()
    backgrounds: str = ""
    image_rate: Annotated[float, Field(gt=0, le=30)] = 5.0
    image_quality: Annotated[int, Field(ge=1, le=100)] = 70
    speed: Annotated[float, Field(gt=0, le=5)] = 0.8
    turn_rate: Annotated[float, Field(gt=0, le=5)] = 0.8

    def __post_init__(self) -> None:
        """Refuses to be seen from elsewhere by whoever comes.

        Raises:
            ValueError: another address than loopback without a token, half of a certificate, or an origin that is none.
        """
        if not self.is_local and not self.token_file:
            raise ValueError(
                f"`host` {self.host} can be reached from elsewhere: name a `token_file`, or keep to 127.0.0.1."
            )
        if bool(self.certificate) != bool(self.private_key):
            raise ValueError("`certificate` and `private_key` belong together: name both, or none.")
        for origin in self.origins:
            scheme, separator, rest = origin.partition("://")
            if scheme not in ("http", "https") or not separator or not rest or "/" in rest:
                raise ValueError(f"`origins` are written as https://host or http://host:port, not '{origin}'.")

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach it."""
        if self.host in _LOCAL_NAMES:
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def path(self, text: str, config: Path) -> Path:
        """A path of these settings; a relative one begins at the robot's TOML file."""
        return config.absolute().parent / Path(text).expanduser()

    @property
    def address(self) -> str:
        """What an operator types into a browser."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.certificate else 'http'}://{host}:{self.port}"

"""What ``vtr doctor`` checks of the fleet's object storage: reached, and keeping the condition that commits rely on."""

from __future__ import annotations

import dataclasses

from cli.doctor.check import Check
from common.config import RobotConfig
from common.environment.metadata import prefix
from common.errors import ConfigurationError
from common.objects import ObjectStore, StorageError, StorageSettings, StorageUnsuitable
from common.objects.settings import read_credentials
from services.fleet.settings import Settings as FleetSettings
from services.mapstore.settings import Settings as StoreSettings
from services.storage.settings import Settings as EmbeddedSettings

_CONNECT_S, _ANSWER_S = 2.0, 5.0
_OF_THE_SERVER = "derived/doctor/"
"""What the server writes there it can make again, and nobody else reads."""


def storage_of(configuration: RobotConfig) -> StorageSettings | None:
    """How this robot, or this server, reaches the storage; None where it shares nothing."""
    base = configuration.path.absolute().parent
    if not configuration.of_fleet:
        found: StorageSettings = configuration.settings("mapstore", StoreSettings).sync
    else:
        found = configuration.settings("fleet", FleetSettings)
        if not found.endpoint:
            embedded = configuration.settings("storage", EmbeddedSettings)
            found = embedded.reached(configuration.directory.absolute(), base)
    if not found.endpoint:
        return None
    return dataclasses.replace(
        found,
        credentials=base / found.credentials,
        ca=None if found.ca is None else base / found.ca,
        connect_s=min(found.connect_s, _CONNECT_S),
        answer_s=min(found.answer_s, _ANSWER_S),
    )


def check_storage(configuration: RobotConfig) -> list[Check]:
    """Whether the storage is reached with these credentials, and whether it honours conditional puts."""
    settings = storage_of(configuration)
    if settings is None:
        return [Check("storage", "ok", "none is configured: nothing is shared")]
    if configuration.of_fleet and not settings.credentials.exists():
        return [Check("storage", "ok", "the embedded storage makes its credentials at its first start")]
    try:
        store = ObjectStore(settings, read_credentials(settings.credentials))
    except (ConfigurationError, OSError, ValueError) as error:
        return [Check("storage", "fail", str(error), "copy the file that the server made for this robot, chmod 600")]
    return _asked(store, _OF_THE_SERVER if configuration.of_fleet else prefix(configuration.robot.name))


def _asked(store: ObjectStore, place: str) -> list[Check]:
    endpoint = store.settings.endpoint
    try:
        store.check_conditional(place)
    except StorageUnsuitable as error:
        reached = Check("storage", "ok", f"{endpoint} answers")
        return [reached, Check("conditional puts", "fail", str(error), "robots would overwrite each other's maps")]
    except StorageError as error:
        advice = "see whether it is up (vtr fleet ps), the endpoint, the network and the credentials"
        return [Check("storage", "fail", str(error), advice)]
    return [
        Check("storage", "ok", f"{endpoint} answers, and lets this machine write below {place}"),
        Check("conditional puts", "ok", "an object that is there is not overwritten"),
    ]

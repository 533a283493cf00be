"""What the fleet's storage holds in the end: every map is fetched, verified, and taken into a store, as a robot would.

``python -m bench.bad_network.inventory FOLDER`` runs on the server's side of the network.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path

from bench.bad_network.agent import crc_of
from bench.bad_network.plan import Plan
from bench.bad_network.site import ENVIRONMENT, FLEET, STORAGE
from common.environment.metadata import MapMetadata, archive_key, prefix
from common.ids import VertexId
from common.messages import GraphQuery
from common.objects import ObjectStore, StorageSettings
from common.objects.embedded import SERVER, credentials_file
from common.objects.settings import read_credentials
from services.mapstore.archive import import_archive
from services.mapstore.settings import Settings
from services.mapstore.store import Store


def contents(store: Store) -> dict[str, list[int]]:
    """The checksum of each vertex of each map of a store."""
    found = {}
    for summary in store.maps(GraphQuery()).maps:
        name = summary.record.id
        vertices = [VertexId(name, k) for k in range(summary.vertices)]
        found[name] = [crc_of(store.submap(GraphQuery(vertices=[v])).vertices[0].keyframe) for v in vertices]
    return found


def main() -> None:
    """Prints the contents of the storage, and how many objects there are of each map."""
    folder = Path(sys.argv[1])
    plan = Plan.parse((folder / "plan.json").read_text(encoding="utf-8"))
    credentials = read_credentials(credentials_file(folder / "data" / FLEET, SERVER))
    objects = ObjectStore(StorageSettings(endpoint=STORAGE), credentials)
    metadata: list[str] = []
    archives: list[str] = []
    with contextlib.closing(Store(folder / "inventory" / "maps.sqlite", Settings(reserve_mb=0))) as store:
        for robot in plan.robots:
            archives += [one.key for one in objects.listed("maps", prefix(robot))]
            for one in objects.listed("environments", f"{prefix(robot)}{ENVIRONMENT}/maps/"):
                told = MapMetadata.model_validate_json(objects.get("environments", one.key))
                metadata.append(told.name)
                file = folder / "inventory" / f"{told.name}.zip"
                objects.download("maps", archive_key(ENVIRONMENT, told.name), file)
                import_archive(store, file, told.archive, told.name)
        print(json.dumps({"metadata": metadata, "archives": archives, "contents": contents(store)}))


if __name__ == "__main__":
    main()

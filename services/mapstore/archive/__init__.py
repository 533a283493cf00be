"""A finished map as one file that can be carried anywhere, and that is not believed before all of it was verified.

A zip without compression, the same bytes whenever the same map is written: ``manifest.json`` (:mod:`manifest`), a
member for each vertex and one for every few dozen edges, each the bytes of a message (:mod:`common.wire`).
"""

from services.mapstore.archive.errors import ArchiveError
from services.mapstore.archive.importing import import_archive
from services.mapstore.archive.reading import ArchiveReader, verify
from services.mapstore.archive.writing import write_archive

__all__ = ["ArchiveError", "ArchiveReader", "import_archive", "verify", "write_archive"]

"""Uploads that go on where they were cut: S3's multipart upload, whose parts are kept until it is completed."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from common.objects.errors import StorageError, StorageMissing, StorageUnreachable
from common.objects.store import Advance, ObjectStore

PART_BYTES = 5 * 1024 * 1024
"""S3's least size of a part that is not the last: the most that is sent twice."""

_UPLOAD = re.compile(rb"<UploadId>([^<]+)</UploadId>")
_PARTS = re.compile(rb"<Part>(.*?)</Part>", re.DOTALL)
_NUMBER = re.compile(rb"<PartNumber>(\d+)</PartNumber>")
_TAG = re.compile(rb"<ETag>(?:&#34;|&quot;|\")?([^<&\"]+)(?:&#34;|&quot;|\")?</ETag>")


def upload(store: ObjectStore, bucket: str, key: str, file: Path, advance: Advance = lambda _: None) -> None:
    """Uploads a file under a key, which has it whole or not at all.

    The upload's id is kept beside the file, so that a run that was killed is gone on with: parts that arrived whole, as
    their MD5 sums tell, are not sent again.

    Raises:
        StorageError: as the storage says; another run goes on.
        OSError: the file cannot be read, or its upload's id not be kept.
    """
    size = file.stat().st_size
    note = file.with_name(file.name + ".upload")
    upload_id, arrived = _present(store, bucket, key, note)
    if upload_id is None:
        upload_id, arrived = _begin(store, bucket, key, note), {}
    tags: list[str] = []
    with file.open("rb") as raw:
        for number in range(1, max(1, -(-size // PART_BYTES)) + 1):
            content = raw.read(PART_BYTES)
            tag = hashlib.md5(content, usedforsecurity=False).hexdigest()
            if arrived.get(number) != tag:
                _send(store, bucket, key, upload_id, number, content, tag)
            tags.append(tag)
            advance(min(size, number * PART_BYTES))
    _complete(store, bucket, key, upload_id, tags)
    note.unlink(missing_ok=True)


def _present(store: ObjectStore, bucket: str, key: str, note: Path) -> tuple[str | None, dict[int, str]]:
    """The upload that was begun, and the MD5 sums of its parts; None where there is none."""
    try:
        upload_id = note.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None, {}
    try:
        answer = store.request("GET", bucket, key, query={"uploadId": upload_id, "max-parts": "1000"})
    except StorageMissing:
        return None, {}
    parts: dict[int, str] = {}
    for part in _PARTS.findall(answer.data):
        number, tag = _NUMBER.search(part), _TAG.search(part)
        if number and tag:
            parts[int(number[1])] = tag[1].decode()
    return upload_id, parts


def _begin(store: ObjectStore, bucket: str, key: str, note: Path) -> str:
    answer = store.request("POST", bucket, key, query={"uploads": ""})
    found = _UPLOAD.search(answer.data)
    if found is None:
        raise StorageError(f"the storage at {store.settings.endpoint} gives no id for the upload of {key}")
    upload_id = found[1].decode()
    draft = note.with_name(note.name + ".draft")
    draft.write_text(upload_id, encoding="utf-8")
    draft.replace(note)
    return upload_id


def _send(store: ObjectStore, bucket: str, key: str, upload_id: str, number: int, content: bytes, tag: str) -> None:
    """Sends a part; S3 tells the MD5 sum of what arrived."""
    query = {"partNumber": str(number), "uploadId": upload_id}
    answer = store.request("PUT", bucket, key, query=query, body=content)
    if str(answer.headers.get("ETag", "")).strip('"') != tag:
        raise StorageUnreachable(f"part {number} of {key} arrived spoilt at {store.settings.endpoint}")


def _complete(store: ObjectStore, bucket: str, key: str, upload_id: str, tags: list[str]) -> None:
    rows = "".join(
        f"<Part><PartNumber>{number}</PartNumber><ETag>&quot;{tag}&quot;</ETag></Part>"
        for number, tag in enumerate(tags, 1)
    )
    body = f"<CompleteMultipartUpload>{rows}</CompleteMultipartUpload>".encode()
    answer = store.request("POST", bucket, key, query={"uploadId": upload_id}, body=body)
    if b"<Error>" in answer.data:
        raise StorageError(f"the storage at {store.settings.endpoint} does not put {key} together from its parts")

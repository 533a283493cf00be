"""One connection to the object storage."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.objects.errors import (
    StorageDenied,
    StorageError,
    StorageFull,
    StorageMissing,
    StorageUnreachable,
    StorageUnsuitable,
)
from common.objects.settings import Credentials, StorageSettings

if TYPE_CHECKING:
    from urllib3 import BaseHTTPResponse

_PART = 1 << 20
_MOST_TEXT = 2_000_000
_MISSING = {"NoSuchKey", "NoSuchBucket", "NoSuchUpload", "ResourceNotFound"}
_DENIED = {
    "AccessDenied",
    "AllAccessDisabled",
    "AuthorizationHeaderMalformed",
    "InvalidAccessKeyId",
    "SignatureDoesNotMatch",
}
_FULL = {"InsufficientStorage", "XMinioStorageFull", "QuotaExceeded", "XMinioAdminBucketQuotaExceeded"}
_HTTP = {401: StorageDenied, 403: StorageDenied, 404: StorageMissing, 507: StorageFull}
_CONFLICT = (409, 412)
_OK = range(200, 300)

Advance = Callable[[int], None]
"""Told how many bytes have gone so far."""


@dataclass(frozen=True, slots=True)
class StoredObject:
    """An object's key and size."""

    key: str
    bytes: int


class ObjectStore:
    """The object storage of a fleet; any thread may use it. Every method may raise a :class:`StorageError`."""

    def __init__(self, settings: StorageSettings, credentials: Credentials) -> None:
        # Both take a quarter of a second to import, and a robot without a fleet needs neither.
        import urllib3  # noqa: PLC0415
        from minio import Minio  # noqa: PLC0415

        self.settings = settings
        self._pool = urllib3.PoolManager(
            timeout=urllib3.Timeout(connect=settings.connect_s, read=settings.answer_s),
            retries=False,
            maxsize=8,
            ca_certs=None if settings.ca is None else str(settings.ca),
        )
        self._client = Minio(
            endpoint=settings.host,
            access_key=credentials.access_key,
            secret_key=credentials.secret_key,
            secure=settings.secure,
            region=settings.region,
            http_client=self._pool,
        )

    def get(self, bucket: str, key: str, most: int = 64 * 1024 * 1024) -> bytes:
        """An object that has at most ``most`` bytes."""
        with self._translated(key):
            response = self._client.get_object(bucket_name=bucket, object_name=key)
            try:
                content = response.read(most + 1)
            finally:
                response.close()
                response.release_conn()
        if len(content) > most:
            raise StorageError(f"object {key} has more than {most} bytes, and none of its kind has")
        return content

    def download(self, bucket: str, key: str, file: Path, advance: Advance = lambda _: None) -> None:
        """Appends to ``file`` what it lacks of an object, so that a download that was cut goes on."""
        have = file.stat().st_size if file.exists() else 0
        size = self.stat(bucket, key).bytes
        if have > size:
            file.unlink()
            have = 0
        if have == size:
            return
        with self._translated(key), file.open("ab") as out:
            response = self._client.get_object(bucket_name=bucket, object_name=key, offset=have)
            try:
                for part in response.stream(_PART):
                    out.write(part)
                    have += len(part)
                    advance(have)
            finally:
                response.close()
                response.release_conn()

    def stat(self, bucket: str, key: str) -> StoredObject:
        """Whether an object is there, and its size."""
        with self._translated(key):
            found = self._client.stat_object(bucket_name=bucket, object_name=key)
            return StoredObject(key, int(found.size or 0))

    def listed(self, bucket: str, prefix: str, after: str = "") -> Iterator[StoredObject]:
        """The objects below a prefix in the order of their keys, those after ``after``."""
        with self._translated(prefix):
            found = self._client.list_objects(
                bucket_name=bucket, prefix=prefix, recursive=True, start_after=after or None
            )
            for one in found:
                yield StoredObject(str(one.object_name), int(one.size or 0))

    def folders(self, bucket: str, prefix: str) -> list[str]:
        """The names of what lies below a prefix that ends with a slash, as of folders."""
        with self._translated(prefix):
            found = self._client.list_objects(bucket_name=bucket, prefix=prefix, recursive=False)
            return [str(one.object_name)[len(prefix) :].rstrip("/") for one in found if one.is_dir]

    def put(self, bucket: str, key: str, content: bytes) -> None:
        """Writes an object, over whatever was there."""
        with self._translated(key):
            self._client.put_object(bucket_name=bucket, object_name=key, data=io.BytesIO(content), length=len(content))

    def create(self, bucket: str, key: str, content: bytes) -> bool:
        """Writes an object unless one is there; of many who try at once, one does. Returns whether it is there now.

        After an unknown outcome the object is read back, so that a repeated try is no second one.
        """
        try:
            response = self.request("PUT", bucket, key, body=content, headers={"If-None-Match": "*"}, allow=_CONFLICT)
        except StorageUnreachable:
            if (there := self._holds(bucket, key, content)) is not None:
                return there
            raise
        return response.status not in _CONFLICT or bool(self._holds(bucket, key, content))

    def _holds(self, bucket: str, key: str, content: bytes) -> bool | None:
        """Whether an object has this content; None where there is none."""
        try:
            return self.stat(bucket, key).bytes == len(content) and self.get(bucket, key) == content
        except StorageMissing:
            return None

    def check_conditional(self, prefix: str) -> None:
        """Makes sure that :meth:`create` creates once; ``prefix`` is where this client may write.

        Raises:
            StorageUnsuitable: the storage ignores the condition: two robots could overwrite each other's maps.
        """
        key = f"{prefix}.conditional"
        bucket = self.settings.environments
        self.request("PUT", bucket, key, body=b"1", headers={"If-None-Match": "*"}, allow=_CONFLICT)
        again = self.request("PUT", bucket, key, body=b"2", headers={"If-None-Match": "*"}, allow=_CONFLICT)
        if again.status not in _CONFLICT:
            raise StorageUnsuitable(
                f"the storage at {self.settings.endpoint} ignores conditional puts: use MinIO, SeaweedFS or another S3 "
                "that honours If-None-Match"
            )

    def make_buckets(self) -> None:
        """Makes the two buckets where they are missing."""
        for bucket in (self.settings.maps, self.settings.environments):
            with self._translated(bucket):
                if not self._client.bucket_exists(bucket_name=bucket):
                    self._client.make_bucket(bucket_name=bucket)

    def request(
        self,
        method: str,
        bucket: str,
        key: str,
        *,
        query: Mapping[str, str] | None = None,
        body: bytes = b"",
        headers: dict[str, str] | None = None,
        allow: tuple[int, ...] = (),
    ) -> BaseHTTPResponse:
        """A presigned request: for what the SDK has no call for. An answer other than 2xx or ``allow`` raises."""
        with self._translated(key):
            url = self._client.get_presigned_url(
                method=method, bucket_name=bucket, object_name=key, extra_query_params=dict(query or {})
            )
            response = self._pool.request(method, url, body=body, headers=headers or {}, retries=False)
            text = response.data[:_MOST_TEXT]
        if response.status in _OK or response.status in allow:
            return response
        raise self._refused(response.status, _code_in(text), key)

    @contextlib.contextmanager
    def _translated(self, key: str) -> Iterator[None]:
        from minio.error import InvalidResponseError, S3Error, ServerError  # noqa: PLC0415
        from urllib3.exceptions import HTTPError  # noqa: PLC0415

        try:
            yield
        except S3Error as error:
            status = getattr(error.response, "status", 500)
            raise self._refused(status, error.code or "", key) from None
        except (HTTPError, ServerError, InvalidResponseError, ValueError) as error:
            raise StorageUnreachable(
                f"the storage at {self.settings.endpoint} does not answer ({_reason(error)}): is it up?"
            ) from None

    def _refused(self, status: int, code: str, key: str) -> StorageError:
        where = self.settings.endpoint
        kind = _HTTP.get(status)
        if code in _MISSING or kind is StorageMissing:
            return StorageMissing(f"the storage at {where} has no object {key}")
        if code in _FULL or kind is StorageFull:
            return StorageFull(f"the storage at {where} is full: make room there")
        if code in _DENIED or kind is StorageDenied:
            return StorageDenied(f"the storage at {where} refuses {key} ({code or status}): are the credentials right?")
        return StorageUnreachable(f"the storage at {where} fails for {key} ({code or status}): see its log")


def _code_in(text: bytes) -> str:
    """The code of an S3 error's XML."""
    _, _, rest = text.partition(b"<Code>")
    return rest.partition(b"</Code>")[0].decode(errors="replace")[:64]


def _reason(error: Exception) -> Any:  # noqa: ANN401, for a sentence
    inner = getattr(error, "reason", None) or error
    return type(inner).__name__

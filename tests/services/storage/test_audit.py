import msgpack

from services.storage.audit import Refusal, refusals

RECORD = {"status": 403, "operation": "REST.PUT.OBJECT", "bucket": "maps", "key": "robots/r1/one", "requester": "r2"}


def read(*messages):
    unpacker = msgpack.Unpacker(raw=False)
    unpacker.feed(b"".join(map(msgpack.packb, messages)))
    return list(refusals(unpacker))


def test_a_refused_request_is_told_with_who_and_where():
    told = ["s3.access", 1, RECORD | {"error_code": "AccessDenied"}, {}]
    assert read(told) == [Refusal("r2", "put", "maps/robots/r1/one", "AccessDenied")]


def test_what_was_granted_or_is_no_request_is_passed_over():
    assert read(["s3.access", 1, RECORD | {"status": 200}], 1, "x", [1], ["t", 1, "x"], {"a": 1}) == []

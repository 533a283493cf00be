import socket

from services.router.links import cut


def test_a_link_is_cut_and_no_other():
    with socket.create_server(("127.0.0.1", 0)) as server:
        one, other = (socket.create_connection(server.getsockname()) for _ in range(2))
        accepted = [server.accept()[0] for _ in range(2)]
        host, port = one.getsockname()
        assert cut(f"tls/{host}:{port}")
        assert one.recv(1) == b""
        other.settimeout(5)
        accepted[1].sendall(b"x")
        assert other.recv(1) == b"x"
        assert not cut(f"tls/{host}:1")
        assert not cut("unixsock-stream/anything")
        for connection in (one, other, *accepted):
            connection.close()

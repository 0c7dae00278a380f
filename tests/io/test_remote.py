"""Files of servers, of a server on this machine that counts the bytes that it sends."""

import errno
import json
import os
import re
import sys
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

import gppcs
from gppcs.errors import GppcsError, MissingExtraError
from gppcs.io import copc_writing

pytest.importorskip("fsspec")
pytest.importorskip("aiohttp")

BOX = [0.51, 0.51, 0.61, 0.61]


class Server(ThreadingHTTPServer):
    """Sends the files of a folder, or parts of them, or only a half of what it promises."""

    daemon_threads = True

    def __init__(self, folder):
        super().__init__(("127.0.0.1", 0), Handler)
        self.folder, self.n_sent, self.sends_parts, self.tells_size, self.breaks_off = folder, 0, True, True, False
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def address(self, name):
        return f"http://127.0.0.1:{self.server_port}/{name}"


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_GET(self):
        path = self.server.folder / self.path.removeprefix("/").partition("?")[0]
        if not path.is_file():
            self.send_error(404)
            return
        content = path.read_bytes()
        span = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", "")) if self.server.sends_parts else None
        if span:
            first, last = int(span[1]), min(int(span[2]), len(content) - 1)
            size, content = len(content), content[first : last + 1]
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
        else:
            self.send_response(200)
        if self.server.tells_size:
            self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command == "GET":
            content = content[: len(content) // 2] if self.server.breaks_off else content
            self.server.n_sent += len(content)
            try:
                self.wfile.write(content)
            except ConnectionError:  # the client wants no more
                self.close_connection = True
        self.close_connection = self.close_connection or self.server.breaks_off or not self.server.tells_size

    do_HEAD = do_GET  # noqa: N815

    def log_message(self, *_):
        pass


@pytest.fixture
def server(tmp_path):
    server = Server(tmp_path)
    yield server
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def copc(tmp_path_factory):
    """The content of a COPC file of flat ground, in nodes as small as in files of some million points."""
    path = tmp_path_factory.mktemp("copc") / "a.copc.laz"
    points = np.random.default_rng(0).random((700_000, 3)) * [1, 1, 1e-3]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(copc_writing, "FEWEST", 1)
        gppcs.write(path, gppcs.PointCloud(np.round(points, 6)))
    return path.read_bytes()


def test_of_a_copc_file_only_the_nodes_are_fetched_that_a_query_needs(tmp_path, server, copc, monkeypatch):
    (tmp_path / "a.copc.laz").write_bytes(copc)
    for query in ({"inside": BOX}, {"resolution": 0.02}):
        server.n_sent = 0
        expected = gppcs.open(tmp_path / "a.copc.laz", **query).read()
        assert gppcs.open(server.address("a.copc.laz"), **query).read() == expected
        assert server.n_sent <= 0.05 * len(copc)
    for memory, inside, most in ((None, BOX, 0.05), ("1GB", None, 1.02)):  # what is read several times is fetched once
        server.n_sent = 0
        part = gppcs.open(server.address("a.copc.laz"), inside=inside)
        gppcs.simplify(part, n_points=50, method="random", memory=memory)
        assert server.n_sent <= most * len(copc)
        monkeypatch.setattr(gppcs.Random, "memory", lambda *_: 10**12)
    assert gppcs.read(server.address("a.copc.laz?key=1")) == gppcs.read(tmp_path / "a.copc.laz")


@pytest.mark.parametrize("name", ["a.las", "a.laz", "a.ply", "a.csv.gz", "a.npy"])
def test_other_files_are_read_whole(tmp_path, server, name):
    gppcs.write(tmp_path / name, gppcs.PointCloud(np.random.default_rng(0).random((500, 3))))
    assert gppcs.read(f"{server.address(name)}?key=1") == gppcs.read(tmp_path / name)
    server.sends_parts = False
    assert gppcs.open(server.address(name), inside=BOX).read() == gppcs.open(tmp_path / name, inside=BOX).read()


@pytest.mark.parametrize("tells_size", [True, False])
def test_a_server_without_parts_sends_all_with_a_note(tmp_path, server, copc, tells_size):
    (tmp_path / "a.copc.laz").write_bytes(copc)
    server.sends_parts, server.tells_size = False, tells_size
    with pytest.warns(UserWarning, match="sends no parts of files"):
        cloud = gppcs.open(server.address("a.copc.laz"), inside=BOX).read()
    assert cloud == gppcs.open(tmp_path / "a.copc.laz", inside=BOX).read()


@pytest.mark.parametrize("is_remote", [False, True])
def test_a_list_may_have_addresses(tmp_path, server, is_remote):
    points = np.random.default_rng(0).random((30, 3))
    for name, part in (("a.laz", points[:20]), ("b.laz", points[20:])):
        gppcs.write(tmp_path / name, gppcs.PointCloud(np.round(part, 3)))
    names = ["./a.laz", server.address("b.laz")]
    features = [{"assets": {"data": {"href": name, "roles": ["data"]}}} for name in names]
    (tmp_path / "a.vpc").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    cloud = gppcs.read(server.address("a.vpc") if is_remote else tmp_path / "a.vpc")
    np.testing.assert_allclose(cloud.points, np.round(points, 3))


@pytest.mark.parametrize("name", ["a.copc.laz", "a.laz"])
def test_a_file_that_is_sent_half_is_an_error_and_nothing_is_written(tmp_path, server, copc, name):
    (tmp_path / name).write_bytes(copc)
    if name == "a.laz":
        gppcs.write(tmp_path / name, gppcs.PointCloud(np.eye(3)), force=True)
    server.breaks_off = True
    with pytest.raises((GppcsError, OSError), match=re.escape(server.address(name))):
        gppcs.write(tmp_path / "out.ply", server.address(name))
    assert not list(tmp_path.glob("*out*"))


def test_what_does_not_answer_is_an_error(server):
    with pytest.raises(OSError, match=re.escape(server.address("none.laz"))):
        gppcs.read(server.address("none.laz"))
    with pytest.raises(OSError, match="look at address, connection"):
        gppcs.read("http://127.0.0.1:1/a.laz")
    with pytest.raises(OSError, match="Protocol not known"):
        gppcs.read("nosuch://a/a.laz")


def test_an_address_without_the_extra_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(MissingExtraError, match="the extra remote"):
        gppcs.read("https://a.org/a.laz")


def test_a_full_disk_is_not_the_fault_of_the_server(tmp_path, server, monkeypatch):
    def fill(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    gppcs.write(tmp_path / "a.ply", gppcs.PointCloud(np.eye(3)))
    monkeypatch.setattr("shutil.copyfileobj", fill)
    with pytest.raises(OSError, match="space") as caught:
        gppcs.read(server.address("a.ply"))
    assert tempfile.gettempdir() in str(caught.value)
    assert "credentials" not in str(caught.value)

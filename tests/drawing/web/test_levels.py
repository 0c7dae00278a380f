"""A COPC file by level: what the page and its nodes hold, and who is served."""

import http.client
import re
import socket
from threading import Thread

import numpy as np
import pytest

import gppcs
from copc_file import write_copc
from formats import overwrite
from gppcs.drawing.web.levels import FIRST, Levels
from gppcs.drawing.web.serving import LevelsServer
from gppcs.io.copc import CopcNodes, nodes_of
from las_file import las_of
from web_page import ServedNode, WebPage

N, DEPTH = 200_000, 4
OTHER_HOSTS = [[], ["evil.example"], ["evil.example:{port}"], ["127.0.0.1"], ["localhost:{port}"]]
OTHER_HOSTS += [["127.0.0.1:{port}", "evil.example"]]
RARE = 17  # a class that no point of the first levels has


@pytest.fixture(scope="module")
def copc(tmp_path_factory):
    """A COPC file of three levels with colours, and one below them."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 100, (2, N))
    corner = np.array([500_000.0, 5_400_000.0, 0.0])
    las = las_of(corner + np.column_stack([x, y, 10 * np.sin(x / 20)]), 7, [0.01, 0.01, 0.001], corner)
    las.intensity, las.red, las.green, las.blue = rng.integers(0, 2**16 - 1, (4, N))
    las.gps_time = np.sort(rng.uniform(0, 9, N))
    las.classification = rng.choice([2, 6], N)
    las.classification[np.flatnonzero(np.arange(N) * 7919 % 8**DEPTH > 4000)[:20]] = RARE  # on the deepest level
    path = tmp_path_factory.mktemp("copc") / "a.copc.laz"
    write_copc(path, las, DEPTH, 4.0)
    return path


@pytest.fixture(scope="module")
def levels(copc):
    with open(copc, "rb") as file:
        yield Levels(CopcNodes(file), "a.copc.laz", [("command", "gppcs view")])


@pytest.fixture(scope="module")
def page(levels):
    return WebPage(levels.page.decode())


@pytest.fixture(scope="module")
def cloud(page):
    [cloud] = page.described["clouds"]
    return cloud


@pytest.fixture(scope="module")
def nodes(levels, cloud):
    """The nodes that the page does not hold."""
    return [ServedNode(cloud, number, levels.node(number)) for number in range(cloud["octree"]["inside"], len(levels))]


@pytest.fixture(scope="module")
def whole(copc):
    return gppcs.read(copc)


@pytest.fixture
def server(levels):
    with LevelsServer(levels) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


def ask(server, path, method="GET", hosts=None):
    """Return the status and the content of an answer."""
    connection = http.client.HTTPConnection(*server.server_address, timeout=30)
    connection.putrequest(method, path, skip_host=True)
    for host in [server.host] if hosts is None else hosts:
        connection.putheader("Host", host)
    connection.endheaders()
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, content


class TestTheNodes:
    def test_together_they_are_the_file_bit_for_bit(self, page, cloud, nodes, whole):
        rows = page.array(cloud["blocks"]["rows"], cloud["shown"], 1, np.uint32)[:, 0]
        assert FIRST <= len(rows) < N
        assert np.abs(page.points(cloud) - whole.points[rows]).max() <= 0.5001 * max(cloud["step"])
        for node in nodes:
            assert node.points.tobytes() == whole.points[node.rows].tobytes()
        assert np.array_equal(np.sort(np.concatenate([rows, *(node.rows for node in nodes)])), np.arange(N))

    def test_they_lie_in_their_cells(self, cloud, nodes):
        octree = cloud["octree"]
        for node in nodes:
            side = octree["side"] / 2**node.level
            low = np.array(octree["low"]) + np.array(node.cell) * side
            assert (node.points >= low - 0.01).all()
            assert (node.points <= low + side + 0.01).all()

    def test_their_values_and_colours_are_those_of_the_file(self, nodes, whole):
        node = nodes[-1]
        part = whole.take(node.rows)
        assert np.array_equal(node.values("attribute:intensity"), part.attributes["intensity"])
        assert np.abs(node.values("attribute:gps_time") - part.attributes["gps_time"]).max() < 9 / 30_000
        assert np.abs(node.values("z") - part.points[:, 2]).max() < 20 / 30_000
        colours = np.stack([part.attributes[name] for name in ("red", "green", "blue")], axis=1)
        assert np.array_equal(node.colours, np.round(colours / 257.0))

    def test_a_class_that_the_first_levels_lack_is_unknown(self, cloud, nodes, whole):
        [held] = [values for values in cloud["values"] if values["key"] == "attribute:classification"]
        assert held["categories"] == [2, 6]
        expected = np.where(whole.attributes["classification"] == RARE, np.nan, whole.attributes["classification"])
        assert np.isnan(expected).any()
        for node in nodes:
            assert np.array_equal(node.values("attribute:classification"), expected[node.rows], equal_nan=True)

    def test_only_the_served_page_may_ask_for_more(self, page):
        [policy] = re.findall(r'Content-Security-Policy" content="(.*?)"', page.text)
        assert policy.startswith("default-src 'none'; connect-src 'self'; ")


class TestTheServer:
    def test_it_hands_out_the_page_and_its_nodes(self, server, levels):
        path = server.url.removeprefix(f"http://{server.host}")
        assert ask(server, path) == (200, levels.page)
        last = len(levels) - 1
        assert ask(server, f"{path}{last}") == (200, levels.node(last))

    def test_only_this_machine_can_connect(self, server):
        host, port = server.server_address
        assert host == "127.0.0.1"
        with socket.socket() as other, pytest.raises(OSError, match=r"refused|unreachable|assign"):
            other.connect(("127.0.0.2", port))

    @pytest.mark.parametrize("path", ["/", "/{token}x/", "/x{token}/1", "/guess/1", "/{upper}/", "/%e9/"])
    def test_without_the_token_there_is_nothing(self, server, levels, path):
        status, content = ask(server, path.format(token=server.token, upper=server.token.swapcase()))
        assert status == 403
        assert content != levels.page

    @pytest.mark.parametrize("hosts", OTHER_HOSTS)
    def test_another_name_of_the_host_is_refused(self, server, levels, hosts):
        named = [host.format(port=server.server_address[1]) for host in hosts]
        for path in ("", "1"):
            status, content = ask(server, f"/{server.token}/{path}", hosts=named)
            assert status in (400, 421)
            assert levels.page not in content

    @pytest.mark.parametrize("path", ["..", "99999", "9" * 400, "-1", "1/..", "1?a", "%31", "page.html"])
    def test_there_are_no_other_paths(self, server, path):
        assert ask(server, f"/{server.token}/{path}")[0] == 404
        assert ask(server, f"/{server.token}")[0] == 404

    @pytest.mark.parametrize("begun", ["", "GET /{token}/ HTTP/1.1\r\nHost"])
    def test_a_silent_connection_is_closed(self, server, monkeypatch, begun):
        monkeypatch.setattr(server.RequestHandlerClass, "timeout", 0.2)
        with socket.create_connection(server.server_address, timeout=30) as silent:
            silent.sendall(begun.format(token=server.token).encode())
            assert silent.recv(1) == b""


def test_a_damaged_node_is_an_error_and_the_others_are_served(copc, tmp_path):
    path = tmp_path / "damaged.copc.laz"
    path.write_bytes(copc.read_bytes())
    with open(copc, "rb") as file:
        entry = CopcNodes(file).entries[-1]
    overwrite(path, int(entry["offset"]) + 80, b"\xff" * (int(entry["size"]) - 80))
    with open(path, "rb") as file, LevelsServer(Levels(CopcNodes(file), "damaged", [])) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        last = len(server.levels) - 1
        assert ask(server, f"/{server.token}/{last}")[0] == 500
        assert ask(server, f"/{server.token}/{last - 1}")[0] == 200
        server.shutdown()


def test_only_copc_files_that_are_large_enough_have_nodes(copc, tmp_path):
    gppcs.write(tmp_path / "a.laz", gppcs.sample("bracket", 400))
    for path, more_than in ((tmp_path / "a.laz", 0), (tmp_path / "none.copc.laz", 0), (copc, N)):
        with nodes_of(path, more_than) as nodes:
            assert nodes is None
    with nodes_of(copc, N - 1) as nodes:
        assert nodes.entries["count"].sum() == N

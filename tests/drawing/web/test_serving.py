"""The server of pages by level."""

import os
import socket
import threading
import time

import pytest

from gppcs.drawing.web.serving import LevelsServer

resource = pytest.importorskip("resource", reason="limits as on Unix")


@pytest.fixture
def no_descriptors():
    """Leave no descriptor to open."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    taken = [os.dup(0)]
    resource.setrlimit(resource.RLIMIT_NOFILE, (taken[0] + 20, hard))

    def take_all():
        while True:
            try:
                taken.append(os.dup(0))
            except OSError:
                return

    yield take_all
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    for descriptor in taken:
        os.close(descriptor)


class CountingServer(LevelsServer):
    """Counts how often it tries to accept a connection."""

    tries = 0

    def get_request(self):
        self.tries += 1
        return super().get_request()


def test_a_connection_without_a_descriptor_left_is_seldom_tried(no_descriptors):
    with CountingServer(None) as server, socket.socket() as client:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        no_descriptors()
        client.connect(server.server_address)
        time.sleep(0.5)
        server.shutdown()
        thread.join()
    assert 1 <= server.tries <= 10

"""What a notebook shows of clouds and results, and the viewer in it."""

import base64
import html
import re
import sys
import webbrowser
from html.parser import HTMLParser
from pathlib import Path
from unittest.mock import Mock
from urllib.parse import urlparse
from urllib.request import url2pathname

import numpy as np
import pytest

import gppcs
from web_page import WebPage


class Elements(HTMLParser):
    """The elements of a piece of HTML, and its text."""

    def __init__(self, text):
        super().__init__()
        self.found, self.text = [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.found.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture
def cloud():
    return gppcs.sample("bracket", n_points=2000)


def test_a_cloud_is_a_table_and_a_picture(cloud):
    pytest.importorskip("matplotlib")
    shown = Elements(cloud._repr_html_())
    (picture,) = [attributes for tag, attributes in shown.found if tag == "img"]
    assert base64.b64decode(picture["src"].removeprefix("data:image/png;base64,")).startswith(b"\x89PNG")
    assert picture["alt"] == "coloured by RGB"
    rows = dict(zip(shown.text[1::2], shown.text[2::2], strict=True))
    assert rows["points"] == "2,000"
    assert [float(value) for value in rows["high corner"].split()] == pytest.approx(cloud.points.max(axis=0), rel=1e-5)
    assert "curvature (float32), red (uint8)" in rows["attributes"]


def test_a_result_tells_its_method(cloud):
    result = gppcs.simplify(cloud, n_points=100, method="fps")
    shown = Elements(result._repr_html_()).text
    assert shown[shown.index("points") + 1] == "100"
    assert shown[shown.index("method") + 1] == repr(result.method)


def test_without_matplotlib_the_table_remains(cloud, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    shown = cloud._repr_html_()
    assert "<img" not in shown
    assert "2,000" in shown


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((3, 3), np.nan), [[-1.7e308, 0, 0], [1.7e308, 0, 0]]])
def test_what_cannot_be_drawn_is_a_table(points):
    shown = gppcs.PointCloud(points)._repr_html_()
    assert "<img" not in shown
    assert f"{len(points)}</td>" in shown


def test_of_a_large_cloud_some_points_are_drawn(monkeypatch):
    pytest.importorskip("matplotlib")
    drawn = Mock(wraps=gppcs.drawing.notebook.draw_single)
    monkeypatch.setattr("gppcs.drawing.notebook.draw_single", drawn)
    monkeypatch.setattr("gppcs.drawing.notebook.MOST_DRAWN", 100)
    assert "2,000" in gppcs.sample("sphere", n_points=2000)._repr_html_()
    assert 50 < len(drawn.call_args.args[1]) <= 100


MARKUP = '<img src=x onerror="alert(1)">'


def test_names_are_text(notebook):
    cloud = gppcs.PointCloud(np.eye(3), {MARKUP: np.arange(3)})
    assert MARKUP in "".join(Elements(cloud._repr_html_()).text)
    assert MARKUP not in cloud._repr_html_()
    cloud.show()
    assert MARKUP not in html.unescape(notebook[0])


def page_in(shown):
    """Return the page in the frame that a notebook shows."""
    ((_, attributes),) = [element for element in Elements(shown).found if element[0] == "iframe"]
    assert "default-src 'none'; script-src 'sha256-" in attributes["srcdoc"]
    return WebPage(attributes["srcdoc"])


def test_the_viewer_is_shown_in_a_notebook(cloud, notebook):
    cloud.show(up="y", view=(10, 20))
    page = page_in(notebook[0]).described
    assert [(each["name"], each["points"]) for each in page["clouds"]] == [("cloud", 2000)]
    assert (page["up"], page["azimuth"], page["elevation"]) == ("y", 10, 20)


def test_a_result_is_shown_beside_its_original(cloud, notebook):
    result = gppcs.simplify(cloud, n_points=100, method="fps")
    result.show()
    result.show(cloud.points)
    alone, both = (page_in(shown).described["clouds"] for shown in notebook)
    assert [each["role"] for each in alone] == ["cloud"]
    assert [(each["name"], each["role"]) for each in both] == [("original", "original"), ("fps", "result")]
    assert both[1]["prefixes"][-1]["points"] == 100


@pytest.mark.parametrize("is_opened", [True, False])
def test_elsewhere_the_viewer_opens_in_the_browser(cloud, monkeypatch, tmp_path, capsys, is_opened):
    pages = []
    monkeypatch.setattr(webbrowser, "open", lambda page: pages.append(page) or is_opened)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    cloud.show()
    path = Path(url2pathname(urlparse(pages[0]).path))
    assert WebPage(path.read_text("utf-8")).described["clouds"][0]["points"] == 2000
    told = re.findall(r"no browser was found; open (.*) yourself\n", capsys.readouterr().out)
    assert told == ([] if is_opened else [str(path)])


def test_what_cannot_be_shown_is_refused(cloud, notebook):
    with pytest.raises(gppcs.InputError, match="cloud: expected points with finite coordinates"):
        gppcs.PointCloud(np.zeros((0, 3))).show()
    with pytest.raises(gppcs.ParameterError, match="found 'w'"):
        cloud.show(up="w")
    assert notebook == []

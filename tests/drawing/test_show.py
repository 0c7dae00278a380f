"""The viewer in a notebook and in the browser."""

import html
import re
import webbrowser
from pathlib import Path
from urllib.parse import urlparse
from urllib.request import url2pathname

import pytest

import gppcs
from web_page import WebPage


@pytest.fixture
def cloud():
    return gppcs.sample("bracket", n_points=2000)


def page_in(shown):
    """Return the page in the frame that a notebook shows."""
    (page,) = re.findall(r'<iframe [^>]*srcdoc="(.*?)"', shown, re.DOTALL)
    assert "default-src 'none'; script-src 'sha256-" in html.unescape(page)
    return WebPage(html.unescape(page))


def test_the_viewer_is_shown_in_a_notebook(cloud, notebook):
    gppcs.show(cloud, up="y", view=(10, 20))
    page = page_in(notebook[0]).described
    assert [(each["name"], each["points"]) for each in page["clouds"]] == [("cloud", 2000)]
    assert (page["up"], page["azimuth"], page["elevation"]) == ("y", 10, 20)


def test_a_result_is_shown_beside_its_original(cloud, notebook):
    result = gppcs.simplify(cloud, n_points=100, method="fps")
    gppcs.show(result)
    gppcs.show(result, cloud.points)
    alone, both = (page_in(shown).described["clouds"] for shown in notebook)
    assert [each["role"] for each in alone] == ["cloud"]
    assert [(each["name"], each["role"]) for each in both] == [("original", "original"), ("fps", "result")]
    assert both[1]["prefixes"][-1]["points"] == 100


@pytest.mark.parametrize("is_opened", [True, False])
def test_elsewhere_the_viewer_opens_in_the_browser(cloud, monkeypatch, tmp_path, capsys, is_opened):
    pages = []
    monkeypatch.setattr(webbrowser, "open", lambda page: pages.append(page) or is_opened)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    gppcs.show(cloud)
    path = Path(url2pathname(urlparse(pages[0]).path))
    assert WebPage(path.read_text("utf-8")).described["clouds"][0]["points"] == 2000
    told = re.findall(r"no browser was found; open (.*) yourself\n", capsys.readouterr().out)
    assert told == ([] if is_opened else [str(path)])

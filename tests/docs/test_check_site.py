"""The check of the built site finds what it is there to find."""

import check_site
import pytest

GOOD = '<html><head><title>a</title></head><body><h1 id="top">A</h1>{}</body></html>'


@pytest.fixture
def site(tmp_path):
    def write(body: str):
        (tmp_path / "deep").mkdir(exist_ok=True)
        (tmp_path / "index.html").write_text(GOOD.format(body), encoding="utf-8")
        (tmp_path / "deep" / "b.html").write_text(GOOD.format('<a href="../index.html#top">a</a>'))
        return tmp_path

    return write


def test_good_links_are_good(site):
    links = (
        '<a href="deep/b.html#top">b</a><a href="https://example.org/">c</a><a href="#top">d</a>'
    )
    assert check_site.broken_links(site(links)) == []


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ('<a href="c.html">c</a>', "index.html: nothing at c.html"),
        ('<img src="no.png">', "index.html: nothing at no.png"),
        ('<a href="deep/b.html#end">b</a>', "index.html: no anchor deep/b.html#end"),
        ('<a href="#end">b</a>', "index.html: no anchor #end"),
    ],
)
def test_broken_links_are_named(site, body, fault):
    assert check_site.broken_links(site(body)) == [fault]


@pytest.mark.slow
def test_the_browser_sees_faults_at_the_width_that_has_them(site):
    browser = check_site.find_browser()
    if browser is None:
        pytest.skip("needs Chromium; the environment variable CHROMIUM names one")
    faults = (
        '<div style="width:600px">wide</div><img src="no.png" alt="">'
        '<script>console.error("spilt", 3); missing()</script>'
    )
    found = check_site.look(site(faults), browser)
    for width in check_site.WIDTHS:
        mine = [line for line in found if line.startswith(f"/index.html at {width}: ")]
        for part in ("console: spilt 3", "script: ", "broken picture no.png"):
            assert any(part in line for line in mine), found
        assert any("wider than" in line for line in mine) == (width < 600)
    assert not any("b.html" in line for line in found)


def test_an_empty_site_is_no_success(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(check_site, "find_browser", lambda: None)
    assert check_site.check(tmp_path) == 1
    assert "Left out: no Chromium" in capsys.readouterr().out

"""Former words (docs/writing.md) are printed nowhere, and help says what it is about."""

import re
from importlib import resources

import pytest
from website.pages import DOCS

from medialis import OPERATIONS

FORMER = re.compile(
    r"\bseams?\b|\bA[13]\b|\brho\b|\bepsilon\b|click to ask|inside too\b|\bfootprint\b|\bcomplex\b",
    re.IGNORECASE,
)


def helps():
    for chosen in OPERATIONS:
        yield chosen.name, " ".join([chosen.help, *chosen.layers.values()])
        for option in chosen.parameters:
            yield f"{chosen.name}.{option.name}", " ".join([option.help, *option.choice_help])


@pytest.mark.parametrize(("name", "text"), [*helps()])
def test_former_words_are_not_in_help(name, text):
    assert not FORMER.search(text)


def test_former_words_are_not_on_the_page_of_the_viewer():
    text = (resources.files("medialis.show.viewer") / "page.html").read_text("utf-8")
    assert not FORMER.search(re.sub("<[^>]*>", " ", text))


def test_the_page_has_the_words_that_are_looked_for():
    text = (DOCS / "writing.md").read_text("utf-8")
    for word in ("seam", "A3", "rho", "epsilon", "click to ask", "what is inside too"):
        assert FORMER.search(word) and word in text


def test_the_threshold_of_curve_skeletons_needs_no_theory():
    """Who reads it may never have heard of a medial axis."""
    (chosen,) = [one for one in OPERATIONS if one.name == "curve_skeleton"]
    (text,) = [option.help for option in chosen.parameters if option.name == "threshold"]
    assert not re.search(r"medial|skeleton|geodesic|importance|prun|junction|hang", text)
    assert "limb" in text.lower() and "Larger values" in text

"""Things by name: furcl's own stay, those of a user come and go."""

import pytest

from furcl.errors import LightError
from furcl.registry import Registry


@pytest.fixture
def registry() -> Registry[int]:
    return Registry("light", LightError, {"sky": 1, "image": 2})


def test_things_come_replace_each_other_and_go(registry):
    registry.add("lamp", 3)
    registry.add("lamp", 4)
    assert registry.names() == ("sky", "image", "lamp")
    assert registry.find("lamp", "light:", "register") == 4
    registry.remove("lamp")
    assert registry.things() == {"sky": 1, "image": 2}


def test_what_is_given_out_is_a_copy(registry):
    registry.things()["lamp"] = 3
    assert registry.names() == ("sky", "image")


@pytest.mark.parametrize(("name", "reason"), [("sky", "one of furcl's own"), ("", "empty")])
def test_names_that_cannot_be_taken(registry, name, reason):
    allowed = "the name must not be empty or one of sky, image; choose another"
    with pytest.raises(LightError, match=f"^light '{name}': the name is {reason}; {allowed}$"):
        registry.add(name, 9)
    assert registry.things() == {"sky": 1, "image": 2}


@pytest.mark.parametrize("name", ["sky", "lamp"])
def test_only_what_was_added_is_removed(registry, name):
    with pytest.raises(LightError, match=f"'{name}' was not registered; nothing to remove"):
        registry.remove(name)
    assert registry.things() == {"sky": 1, "image": 2}


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("skye", "did you mean 'sky'\\?"), ("x", "furcl.lights.register adds one")],
)
def test_unknown_names(registry, name, remedy):
    with pytest.raises(LightError, match=f"^light '{name}': known are sky, image; {remedy}$"):
        registry.find(name, f"light {name!r}: known are", "furcl.lights.register")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "lamp.clh cannot be read: No such file"),
        (b"radiance \xff sample", "lamp.clh cannot be read: it is not UTF-8"),
        (b"radiance", "lamp.clh does not define sample; see the page$"),
        (b"radiance resample sample_all", "does not define sample"),  # whole words
    ],
)
def test_headers_that_cannot_be_used(registry, tmp_path, content, message):
    header = tmp_path / "lamp.clh"
    if content is not None:
        header.write_bytes(content)
    with pytest.raises(LightError, match=f"^light 'lamp': .*{message}"):
        registry.check_header("lamp", header, ("radiance", "sample"), "the page")


def test_a_byte_order_mark_is_no_part_of_a_header(registry, tmp_path):
    (tmp_path / "lamp.clh").write_bytes(b"\xef\xbb\xbfradiance sample")
    words = registry.check_header("lamp", tmp_path / "lamp.clh", ("radiance", "sample"), "")
    assert words == {"radiance", "sample"}


def test_words_of_a_header(registry, tmp_path):
    (tmp_path / "lamp.clh").write_text("float radiance(int a);\nsample")
    words = registry.check_header("lamp", tmp_path / "lamp.clh", ("radiance", "sample"), "")
    assert words == {"float", "radiance", "int", "a", "sample"}

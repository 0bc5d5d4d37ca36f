"""Files of the cache: any damage is noticed, and a file that cannot be kept is no error."""

from __future__ import annotations

import logging
import os

import pytest

from furcl import cache

CONTENT = bytes(range(40)) * 3


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "kernels" / "a.bin"
    cache.store(path, CONTENT)
    return path


def test_content_comes_back(path):
    assert cache.load(path) == CONTENT
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("content", [b"", b"x", bytes(1 << 20)], ids=["0", "1", "2^20"])
def test_any_content(path, content):
    cache.store(path, content)
    assert cache.load(path) == content


def test_every_changed_byte_is_noticed(path, caplog):
    whole = path.read_bytes()
    for at in range(len(whole)):
        for changed in (whole[at] ^ 1, whole[at] ^ 0x80):
            path.write_bytes(whole[:at] + bytes([changed]) + whole[at + 1 :])
            assert cache.load(path) is None
    with caplog.at_level(logging.WARNING):
        cache.load(path)
    assert f"{path}: damaged cache file" in caplog.text


def test_every_lost_or_added_part_is_noticed(path):
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        assert cache.load(path) is None
    for added in (b"\0", b"x" * 100, whole):
        path.write_bytes(whole + added)
        assert cache.load(path) is None


@pytest.mark.parametrize("kind", ["absent", "below a file", "pipe", "folder", "device"])
def test_what_is_no_file_is_none(tmp_path, kind):
    path = tmp_path / "a.bin"
    if kind == "below a file":
        path.touch()
        path = path / "b.bin"
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "device":
        path.symlink_to("/dev/zero")
    assert cache.load(path) is None


def test_a_file_that_cannot_be_written_is_logged(tmp_path, caplog):
    (tmp_path / "file").touch()
    with caplog.at_level(logging.WARNING):
        cache.store(tmp_path / "file" / "a.bin", CONTENT)
    assert "nothing is cached there" in caplog.text


def test_a_folder_keeps_what_was_used_last(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "MOST_FILES", 3)
    names = ["a.bin", "b.bin", "c.bin"]
    for age, name in enumerate(names):
        cache.store(tmp_path / name, CONTENT)
        os.utime(tmp_path / name, (age, age))
    (tmp_path / "other.tables").touch()
    assert cache.load(tmp_path / "a.bin") == CONTENT
    cache.store(tmp_path / "d.bin", CONTENT)
    assert {path.name for path in tmp_path.iterdir()} == {
        "a.bin", "c.bin", "d.bin", "other.tables",
    }  # fmt: skip

"""Temporary files are removed, whatever happens to one of them."""

from contextlib import ExitStack

import pytest

from gppcs.engine import unfinished


def test_a_file_that_cannot_be_removed_keeps_no_other(tmp_path, monkeypatch):
    paths = [tmp_path / name for name in ("a", "b", "c")]
    removed = []

    def remove(path):
        removed.append(path)
        raise PermissionError(path)

    with ExitStack() as blocks:
        for path in paths:
            blocks.enter_context(unfinished.unfinished(str(path)))
        with monkeypatch.context() as patch:
            patch.setattr(unfinished, "_remove", remove)
            unfinished.remove_all()
    assert sorted(removed) == sorted(map(str, paths))


@pytest.mark.parametrize("is_folder", [False, True])
def test_what_is_left_is_removed_at_the_end_of_the_block(tmp_path, is_folder):
    path = tmp_path / "part"
    with unfinished.unfinished(str(path)):
        path.mkdir() if is_folder else path.write_text("half")
    assert not path.exists()

"""What the tests of the platform share."""

import shutil

import pytest


@pytest.fixture
def link_programs(tmp_path):
    """Return a function that makes a folder with links to the named programs only."""

    def link(*names):
        folder = tmp_path / "bin"
        folder.mkdir()
        for name in names:
            (folder / name).symlink_to(shutil.which(name))
        return folder

    return link

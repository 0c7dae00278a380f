import pytest


@pytest.fixture
def container(tmp_path):
    """Write what the system tells of control groups: those of the process, and files of theirs; return the root."""

    def write(groups, files):
        for name, content in {
            "proc/self/cgroup": groups,
            **{f"sys/fs/cgroup/{k}": v for k, v in files.items()},
        }.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(content)
        return tmp_path

    return write

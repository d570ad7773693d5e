import pytest
from training_material import FakeStore, make_demonstration, write_demonstrations


@pytest.fixture
def fake_store():
    return FakeStore([make_demonstration(index, steps=6 + index) for index in range(5)])


@pytest.fixture(scope="session")
def demos(tmp_path_factory):
    return write_demonstrations(tmp_path_factory.mktemp("data") / "demos")

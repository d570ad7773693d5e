import pytest
from source_material import make_source, write_shards


@pytest.fixture(scope="session")
def shards(tmp_path_factory):
    return write_shards(tmp_path_factory.mktemp("shards") / "synthetic")


@pytest.fixture
def source_of(shards):
    """Makes sources and closes them."""
    made = []

    def make(name, folder=shards, **options):
        made.append(make_source(name, folder, **options))
        return made[-1]

    yield make
    for source in made:
        source.close()

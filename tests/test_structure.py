"""What the layer contract of pyproject.toml cannot say: imports for types alone make circles, too."""

from graphlib import TopologicalSorter

import grimp
import pytest


@pytest.fixture(scope="module")
def imports():
    graph = grimp.build_graph("geoprior", exclude_type_checking_imports=False, cache_dir=None)
    return {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}


@pytest.mark.parametrize(
    "room", ["geoprior.sim", "geoprior.shards", "geoprior.synthesis", "geoprior.scene", "geoprior.motions"]
)
def test_files_of_a_room_are_in_no_circle_not_even_for_types(imports, room):
    files = {name for name in imports if name.startswith(f"{room}.")}
    assert len(files) > 3, "the test must be able to fail"
    TopologicalSorter({name: imports[name] & files for name in files}).prepare()


def test_a_task_knows_its_own_room_and_what_tasks_share(imports):
    """But for the door that `close` shuts and the area that a cable's plug is brought to."""
    tasks = "geoprior.sim.tasks."
    rooms = {name.split(".")[3] for name in imports if name.startswith(tasks) and name.count(".") > 3}
    assert {"pick", "place", "push"} <= rooms
    across = {
        (one, other)
        for name, imported in imports.items()
        for found in imported
        if name.startswith(tasks) and found.startswith(tasks)
        if (one := name.split(".")[3]) in rooms and (other := found.split(".")[3]) in rooms and one != other
    }
    assert across == {("close", "door"), ("cable", "push")}

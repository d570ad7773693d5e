"""What a process keeps of the environments that it built."""

import gc

import pytest

from geoprior.options import Choice
from geoprior.sim.workers import Setup, environment


@pytest.fixture
def no_collections():
    """Python collects garbage when it has many objects, not when they hold much memory."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def simulations():
    from robosuite.utils.binding_utils import MjSim

    return sum(type(found) is MjSim for found in gc.get_objects())


@pytest.mark.usefixtures("no_collections")
def test_an_environment_is_built_once_and_goes_when_others_took_its_place(ur5e, cameras):
    def build(control_rate):
        return environment(Setup(ur5e, Choice(name="pick"), cameras), control_rate)

    others = [build(10), build(20)]
    assert others == [build(10), build(20)]
    del others
    kept = simulations()
    for control_rate in (25, 50, 100):
        build(control_rate)
    assert simulations() <= kept + 1, "one may wait to be collected; each holds 100 MB"

"""What is kept is made anew when, and only when, it has to be."""

import copy
import pickle

import torch
from torch import nn

from geoprior.policies.fused.kept import Kept, state_of


def test_it_is_made_once_in_a_state():
    kept, made = Kept(), []
    for state in (1, 1, 2, 2, 1):
        kept.get(state, lambda state=state: made.append(state))
    assert made == [1, 2, 1]


def test_copies_are_empty():
    kept = Kept()
    kept.get(1, lambda: "first")
    for twin in (copy.copy(kept), copy.deepcopy(kept), pickle.loads(pickle.dumps(kept))):
        assert twin.get(1, lambda: "second") == "second"
    assert kept.get(1, lambda: "third") == "first"


def make_module():
    return nn.Sequential(nn.Linear(2, 3), nn.Sequential(nn.BatchNorm1d(3))).eval()


def test_every_way_to_change_a_tensor_changes_the_state():
    module = make_module()
    other = {name: tensor.clone() for name, tensor in module.state_dict().items()}
    seen = [state_of(module)]
    assert state_of(module) == seen[0]

    def note():
        seen.append(state_of(module))

    with torch.no_grad():
        module[0].weight.add_(1.0)
    note()
    module[1][0].running_var.mul_(2.0)
    note()
    module.load_state_dict(other)
    note()
    module[0].weight.data = module[0].weight.data.to(torch.bfloat16)
    note()
    module[0].bias = nn.Parameter(torch.zeros(3))
    note()
    module[0] = nn.Linear(2, 3).eval()
    note()
    assert len(set(seen)) == len(seen)


def test_there_is_no_state_while_a_part_learns():
    module = make_module()
    module[1][0].train()
    assert state_of(module) is None

"""Training through torch.compile: the same arithmetic, and a sentence where it cannot work."""

import json
from dataclasses import replace

import pytest
import torch
from training_material import TINY_ACT, make_training

from geoprior.errors import MachineError
from geoprior.training.loop import fit
from geoprior.training.stages import build_policy

# torch's own modules, as torch.compile imports them.
pytestmark = pytest.mark.filterwarnings("ignore:.torch.jit.*deprecated:DeprecationWarning")


def losses(store, folder, **options):
    """Of ACT without dropout, which is drawn in another way when it is compiled."""
    training = make_training(store, folder, epochs=3, image_noise=0.0, **options)
    choice = TINY_ACT.model_copy(update={"options": {**TINY_ACT.options, "dropout": 0.0}})
    fit(replace(training, policy=build_policy(choice, training.policy.features, 0)))
    return [json.loads(line)["loss"] for line in (folder / "log.jsonl").read_text().splitlines()]


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_a_compiled_training_has_the_losses_of_a_plain_one(fake_store, tmp_path, precision):
    plain = losses(fake_store, tmp_path / "plain", precision=precision)
    with torch._inductor.config.patch(fallback_random=True):  # styles are drawn as without compilation
        compiled = losses(fake_store, tmp_path / "compiled", precision=precision, compile=True)
    assert len(set(plain)) > 1
    assert compiled == pytest.approx(plain, rel=1e-4 if precision == "fp32" else 2e-2)


def test_without_a_compiler_a_sentence_says_so(fake_store, tmp_path, monkeypatch):
    monkeypatch.setenv("TORCHINDUCTOR_CACHE_DIR", str(tmp_path / "cache"))
    missing = torch._inductor.config.patch({"cpp.cxx": (None, str(tmp_path / "none"))})
    with (
        missing,
        pytest.raises(MachineError, match=r"(?s)torch.compile fails: .*compiler.*set compile to false"),
    ):
        fit(make_training(fake_store, tmp_path / "run", compile=True))

import pytest
from pydantic import ValidationError

from geoprior.training.config import ConditionConfig, FinetuneConfig, TrainConfig


def test_the_default_compares_scratch_with_the_prior():
    conditions = FinetuneConfig().conditions
    assert {name: condition.init for name, condition in conditions.items()} == {
        "scratch": "scratch",
        "prior": "prior",
    }


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seeds": [1, 1]}, "each must be at least 0 and occur once"),
        ({"seeds": [-1]}, "each must be at least 0 and occur once"),
        ({"seeds": []}, "at least 1"),
        ({"conditions": {}}, "at least 1"),
        ({"conditions": {"../x": {"init": "scratch"}}}, "lower-case letters"),
        ({"conditions": {"Prior": {"init": "prior"}}}, "lower-case letters"),
        ({"learning_rate": 0.0}, "greater than 0"),
        ({"learning_rate": float("nan")}, "finite"),
        ({"epoch": 3}, "Extra inputs"),
    ],
)
def test_faults_are_named(options, message):
    with pytest.raises(ValidationError, match=message):
        FinetuneConfig(**options)


@pytest.mark.parametrize("options", [{"weights": "trunk"}, {"statistics": "merged"}])
def test_scratch_has_nothing_to_take(options):
    with pytest.raises(ValidationError, match="no prior to take"):
        ConditionConfig(init="scratch", **options)


def test_every_field_is_described():
    for model in (TrainConfig, FinetuneConfig, ConditionConfig):
        for name, field in model.model_fields.items():
            assert field.description, f"{model.__name__}.{name}"


def test_the_config_is_light(run_python):
    code = (
        "import sys, geoprior.training.config\n"
        "import geoprior.policies.act.plugin, geoprior.training.loggers.log_file\n"
        "print([m for m in ('torch', 'numpy', 'safetensors') if m in sys.modules])"
    )
    assert run_python(code).strip() == "[]"

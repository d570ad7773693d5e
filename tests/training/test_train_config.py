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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"init": "scratch", "weights": "trunk"}, "no prior to take weights from"),
        ({"init": "imagenet", "weights": "trunk", "statistics": "merged"}, "no prior to take weights from"),
        ({"init": "scratch", "prior": "runs/one"}, "takes nothing from the prior that is named"),
        ({"init": "blind-prior", "prior": "runs/one"}, "this run's own"),
    ],
)
def test_what_a_condition_cannot_take(options, message):
    with pytest.raises(ValidationError, match=message):
        ConditionConfig(**options)


def test_what_a_condition_takes():
    def takes(**options):
        condition = ConditionConfig(**options)
        return condition.takes_weights, condition.takes_from_a_prior

    assert takes(init="scratch") == takes(init="imagenet") == (False, False)
    assert takes(init="scratch", statistics="pretrained") == (False, True)
    assert takes(init="prior") == takes(init="blind-prior", weights="trunk") == (True, True)


def test_a_path_is_said_in_full(tmp_path, monkeypatch):
    """So that a run that is resumed from elsewhere finds it."""
    monkeypatch.chdir(tmp_path)
    condition = ConditionConfig(init="prior", prior="runs/one")
    assert condition.prior == str(tmp_path / "runs" / "one")
    monkeypatch.chdir("/")
    assert ConditionConfig.model_validate(condition.model_dump()) == condition


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

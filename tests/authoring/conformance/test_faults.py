"""Every check can fail: plug-ins that break one sentence each, and what they are told."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydantic import BaseModel

from geoprior.authoring.conformance.suite import FAILED, NOT_RUN, OK, checks_of, find
from geoprior.authoring.scaffold.templates import (
    executor,
    look,
    motion,
    policy,
    primitive,
    renderer,
    robot,
    source,
    task,
    variant,
)
from geoprior.authoring.testing import cases
from geoprior.errors import MachineError
from geoprior.motions.trajectory import HandWay
from geoprior.options import Options
from geoprior.scene.mesh import convex_mesh


def spec_of(module):
    return cases(module)[0].values[0].spec


def finding(spec, sentence):
    (check,) = (check for check in checks_of(spec) if check.sentence == sentence)
    return find(spec, check)


def assert_caught(spec, sentence, complaint):
    found = finding(spec, sentence)
    assert found.status == FAILED, found
    assert complaint in found.text
    assert found.subject == f"{spec.kind} {spec.name}"


# Every kind -----------------------------------------------------------------------------------------


class Writable(BaseModel):
    size: float = 1.0


class Unexplained(Options):
    size: float = 1.0


class Needy(Options):
    size: float


@pytest.mark.parametrize(
    ("change", "sentence", "complaint"),
    [
        ({"name": "Mug_1"}, "a config can name it", "'Mug_1'"),
        ({"summary": " "}, "its summary is one line", "empty"),
        ({"summary": "long\nsummary"}, "its summary is one line", "more than one line"),
        ({"config": Writable}, "its options are frozen and strict", "can be written to"),
        ({"config": Unexplained}, "its options are explained", "option 'size' has no description"),
        ({"config": Needy}, "its defaults build and come back from JSON", "size must be given"),
    ],
)
def test_a_spec(change, sentence, complaint):
    assert_caught(replace(spec_of(variant), **change), sentence, complaint)


def test_what_a_plug_in_raises_is_a_finding_with_the_place():
    def factory(config):
        raise RuntimeError("no licence")

    found = finding(replace(spec_of(variant), factory=factory), "its clouds can be drawn")
    assert found.status == FAILED
    assert "raised RuntimeError: no licence (test_faults.py, line " in found.text


def test_what_the_machine_cannot_do_is_no_fault():
    def factory(config):
        raise MachineError("OpenGL: no library", "install it")

    found = finding(replace(spec_of(variant), factory=factory), "its clouds can be drawn")
    assert (found.status, found.remedy) == (NOT_RUN, "install it")


# Motions --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Changed:
    """The template's motion with its plan changed."""

    config: motion.MyPluginConfig
    change: object

    def plan(self, scene, steps, rng):
        return self.change(motion.MyPlugin(self.config).plan(scene, steps, rng))


def with_way(change, gripper=lambda gripper: gripper):
    def changed(plan):
        way = plan.hand
        frames = change(way.transforms_hand_to_world.copy())
        return replace(plan, hands={"hand": HandWay(frames, gripper(way.gripper.copy()))})

    return changed


def jump(frames):
    frames[30:, 0, 3] += 0.5
    return frames


def mirror(frames):
    frames[:, :3, 0] *= -1.0
    return frames


def stretch(frames):
    frames[:, :3, :3] *= 1.01
    return frames


def elsewhere(frames):
    frames[:, 1, 3] += 0.01
    return frames


def dive(frames):
    frames[1:, 2, 3] -= 0.02 * np.arange(len(frames) - 1)
    return frames


def turn_over(frames):
    frames[40:, :3, :2] *= -1.0
    return frames


def unlike_twice(plan):
    return with_way(lambda frames: frames + 1e-9 * np.random.default_rng().random())(plan)


@pytest.mark.parametrize(
    ("change", "sentence", "complaint"),
    [
        (
            with_way(lambda frames: frames[:-1]),
            "it plans every step of every hand",
            "found float64 (59, 4, 4)",
        ),
        (with_way(lambda f: f, lambda g: g + 0.5), "it plans every step of every hand", "neither 0 (open)"),
        (
            lambda plan: replace(plan, hands={"left": plan.hand}),
            "it plans every step of every hand",
            "moves the hands ['left'], its spec says ['hand']",
        ),
        (lambda plan: replace(plan, phases=()), "it plans every step of every hand", "0 phases"),
        (
            lambda plan: replace(plan, others={"tower": plan.transforms_object_to_world}),
            "it plans every step of every hand",
            "moves ['tower'], which its scene does not have",
        ),
        (with_way(mirror), "its frames are right-handed rotations", "left-handed"),
        (with_way(stretch), "its frames are right-handed rotations", "not orthonormal"),
        (with_way(elsewhere), "it begins where the scene begins", "hand is not where the scene has it"),
        (with_way(jump), "nothing jumps or sinks into the floor", "hand jumps by 0.5"),
        (with_way(dive), "nothing jumps or sinks into the floor", "below the floor"),
        (with_way(turn_over), "its poses are continuous", "more than 120 degrees after step 39"),
        (
            lambda plan: replace(plan, marker_points=np.full((3, 3), 0.3)),
            "its marker lies on the floor",
            "not on the floor",
        ),
        (unlike_twice, "a seed decides the plan, and nothing else does", "the second time"),
    ],
)
def test_a_motion(change, sentence, complaint):
    spec = replace(spec_of(motion), factory=lambda config: Changed(config, change))
    assert_caught(spec, sentence, complaint)


def test_a_motion_that_moves_the_scene():
    class Careless(motion.MyPlugin):
        def plan(self, scene, steps, rng):
            scene.object.transform_object_to_world[0, 3] += 0.01
            return super().plan(scene, steps, rng)

    assert_caught(
        replace(spec_of(motion), factory=Careless), "it leaves the scene alone", "changed the scene"
    )


def test_a_motion_that_stumbles_over_few_steps():
    class Stumbling(motion.MyPlugin):
        def plan(self, scene, steps, rng):
            return super().plan(scene, steps, rng) if steps > 4 else [][0]

    spec = replace(spec_of(motion), factory=Stumbling)
    assert_caught(spec, "few steps are planned or refused", "1 steps raise IndexError")


# Variants and renderers -----------------------------------------------------------------------------


class Blinding:
    def __init__(self, config):
        pass

    def change(self, shots):
        return {"third": shots["third"]}


class Moody(Blinding):
    def change(self, shots):
        shift = np.random.default_rng().random()
        third = shots["third"]
        clouds = tuple(replace(cloud, points=cloud.points + shift) for cloud in third.clouds)
        return {**shots, "third": replace(third, clouds=clouds)}


class Scribbling(Blinding):
    def change(self, shots):
        shots["third"].clouds[0].points[:] = 0.0
        return shots


class Flat(Blinding):
    def change(self, shots):
        flat = replace(shots["third"].clouds[0], points=np.zeros((3, 2)))
        return {**shots, "third": replace(shots["third"], clouds=(flat,))}


@pytest.mark.parametrize(
    ("factory", "sentence", "complaint"),
    [
        (Blinding, "it leaves cameras and steps alone", "was given the cameras"),
        (Moody, "it gives the same clouds each time", "the second time gives other clouds"),
        (Scribbling, "it writes to nothing that it was given", "wrote to the shots"),
        (Flat, "its clouds can be drawn", "expected float64 (any, 3), found float64 (3, 2)"),
    ],
)
def test_a_variant(factory, sentence, complaint):
    assert_caught(replace(spec_of(variant), factory=factory), sentence, complaint)


class Binary(renderer.MyPlugin):
    frames = "binary"

    def __init__(self, config):
        super().__init__(config.model_copy(update={"frames": "binary"}))


class Unpacked(Binary):
    def render(self, shot):
        return np.unpackbits(super().render(shot), axis=-1)


class Overhanging(Binary):
    def render(self, shot):
        return super().render(shot) | 1


class Trailing(Binary):
    def render(self, shot):
        return np.bitwise_or.accumulate(super().render(shot), axis=0)


class White(Binary):
    def render(self, shot):
        return super().render(shot) | 128


class Flickering(renderer.MyPlugin):
    def render(self, shot):
        frames = super().render(shot)
        return np.where(np.random.default_rng().random(frames.shape) < 0.5, frames, 0).astype(np.uint8)


class Silent(renderer.MyPlugin):
    frames = None


class Infrared(renderer.MyPlugin):
    frames = "infrared"


class Coloured(renderer.MyPlugin):
    def render(self, shot):
        return np.repeat(super().render(shot)[..., None], 3, axis=-1)


class Deep(renderer.MyPlugin):
    def render(self, shot):
        return super().render(shot).astype(np.uint16)


class Backdrop(renderer.MyPlugin):
    def render(self, shot):
        return np.maximum(super().render(shot), 30)


KIND = "its frames are what it says that it draws"


@pytest.mark.parametrize(
    ("factory", "sentence", "complaint"),
    [
        (Unpacked, KIND, "expected uint8 (6, 40, 7), found uint8 (6, 40, 56)"),
        (Overhanging, KIND, "beyond the right edge"),
        (Silent, KIND, "its `frames` is None, expected one of 'binary', 'gray', 'rgb'"),
        (Infrared, KIND, "its `frames` is 'infrared'"),
        (
            Coloured,
            KIND,
            "gray frames of 40 x 52 pixels: expected uint8 (6, 40, 52), found uint8 (6, 40, 52, 3)",
        ),
        (Deep, KIND, "found uint16 (6, 40, 52)"),
        (Trailing, "parts of an episode are drawn as the whole is", "two steps at a time"),
        (White, "nothing is drawn as black", "a pixel is not black"),
        (Backdrop, "nothing is drawn as black", "no clouds before the camera, and a pixel is not black"),
        (Flickering, "it writes to nothing and draws the same again", "other frames again"),
    ],
)
def test_a_renderer(factory, sentence, complaint):
    assert_caught(replace(spec_of(renderer), factory=factory), sentence, complaint)


@pytest.mark.parametrize("kind", ["binary", "gray", "rgb"])
def test_a_renderer_of_each_kind_keeps_the_contract(kind):
    spec = spec_of(renderer)
    made = replace(spec, factory=lambda config: spec.factory(config.model_copy(update={"frames": kind})))
    for check in checks_of(made):
        check.run(made)


# Sources, executors and policies --------------------------------------------------------------------


def source_that(change):
    def build(config, context):
        made = source.build(config, context)
        change(made)
        return made

    return replace(spec_of(source), factory=build)


def shuffle_cameras(made):
    made.cameras = made.cameras[::-1]


def change_digest(made):
    made.digest = f"{np.random.default_rng().integers(16):x}" + f"{id(made):063x}"


def drop_an_action(made):
    made.actions = made.actions[:-1]


def be_late(made):
    read = made.read
    made.read = lambda numbers, steps: read(numbers, np.maximum(steps - 1, 0))


def remember(made):
    read, seen = made.read, []

    def remembering(numbers, steps):
        moments = read(numbers, steps)
        seen.append(moments)
        return replace(moments, frames={name: frames // len(seen) for name, frames in moments.frames.items()})

    made.read = remembering


@pytest.mark.parametrize(
    ("change", "sentence", "complaint"),
    [
        (shuffle_cameras, "it says what it holds", "cameras are ('third', 'hand')"),
        (drop_an_action, "its poses are pose vectors", "actions"),
        (be_late, "a read gives what was asked for", "a read gives other poses or actions"),
        (change_digest, "reads do not depend on each other", "another digest"),
        (remember, "reads do not depend on each other", "another moment when it is read alone"),
    ],
)
def test_a_source(change, sentence, complaint):
    assert_caught(source_that(change), sentence, complaint)


class Serial:
    def __init__(self, config):
        pass

    def run(self, function, items):
        for position, item in enumerate(items):
            yield position, function(item)


class Forgetful(Serial):
    def run(self, function, items):
        yield from list(super().run(function, items))[:-1]


class Swallowing(Serial):
    def run(self, function, items):
        for position, item in enumerate(items):
            try:
                yield position, function(item)
            except Exception:  # noqa: BLE001
                continue


class Wrapping(Serial):
    def run(self, function, items):
        try:
            yield from super().run(function, items)
        except Exception as error:
            raise RuntimeError("a worker failed") from error


class OneShot(Serial):
    used = False

    def run(self, function, items):
        if self.used:
            return
        self.used = True
        yield from super().run(function, items)


class Demanding(Serial):
    def run(self, function, items):
        yield 0, function(items[0])


@pytest.mark.parametrize(
    ("factory", "sentence", "complaint"),
    [
        (Forgetful, "it runs every item once", "for the squares of"),
        (Demanding, "it does nothing where nothing is to do", "IndexError"),
        (Swallowing, "a failure of the function arrives", "swallowed"),
        (Wrapping, "a failure of the function arrives", "arrived as RuntimeError"),
        (OneShot, "it can be used again", "cannot be used again"),
    ],
)
def test_an_executor(factory, sentence, complaint):
    assert_caught(replace(spec_of(executor), factory=factory), sentence, complaint)


def policy_that(change):
    def build(config, features):
        made = policy.build(config, features)
        change(made)
        return made

    return replace(spec_of(policy), factory=build)


def misname_the_trunk(made):
    made.trunk_prefixes = ("backbone.",)


def log_nothing(made):
    loss = made.loss
    made.loss = lambda batch: (loss(batch)[0], {})


def detach(made):
    loss = made.loss

    def detached(batch):
        value, metrics = loss(batch)
        return value.detach().requires_grad_(), metrics

    made.loss = detached


def be_noisy(made):
    import torch

    predict = made.predict
    made.predict = lambda observation: predict(observation) + torch.randn(())


def roll_dice_unseen(made):
    import torch

    predict = made.predict

    def rolling(observation):
        torch.rand(())
        return predict(observation)

    made.predict = rolling


def mix_rows(made):
    predict = made.predict
    made.predict = lambda observation: predict(observation) + predict(observation).mean(dim=0)


def keep_something_back(made):
    import torch

    offset, predict = torch.randn(()), made.predict
    made.predict = lambda observation: predict(observation) + offset


def shorten(made):
    predict = made.predict
    made.predict = lambda observation: predict(observation)[:, :-1]


@pytest.mark.parametrize(
    ("change", "sentence", "complaint"),
    [
        (misname_the_trunk, "it is a module of torch", "begins with the trunk prefix 'backbone.'"),
        (log_nothing, "its loss has gradients", "metrics are []"),
        (detach, "its loss has gradients", "no gradient reaches a parameter"),
        (shorten, "its predictions are chunks of actions", "predicts (3, 24, 8), expected (3, 25, 8)"),
        (be_noisy, "its predictions are chunks of actions", "the second time"),
        (roll_dice_unseen, "its predictions are chunks of actions", "torch's global generator"),
        (mix_rows, "the rows of a batch do not mix", "other rows"),
        (keep_something_back, "its weights are all there is to it", "same state dict predict differently"),
    ],
)
def test_a_policy(change, sentence, complaint):
    assert_caught(policy_that(change), sentence, complaint)


@pytest.mark.slow
def test_a_policy_whose_loss_hides_what_it_learns():
    def grow(made):
        loss, calls = made.loss, []

        def growing(batch):
            calls.append(1)
            value, metrics = loss(batch)
            return value + float(len(calls)), metrics

        made.loss = growing

    assert_caught(policy_that(grow), "it learns", "the loss goes from")


def test_a_policy_without_a_chunk():
    spec = replace(spec_of(policy), config=Unexplained)
    assert_caught(spec, "its options have a chunk", "no PolicyOptions")


# Robots, tasks and looks ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"name": "iiwa"}, "the robot's own name is 'iiwa'"),
        ({"home_joints": (0.0, float("nan"))}, "a home joint is not finite"),
        ({"rotation_hand_to_site": ((-1, 0, 0), (0, 1, 0), (0, 0, 1))}, "no right-handed rotation"),
    ],
)
def test_the_numbers_of_a_robot(change, complaint):
    spec = replace(spec_of(robot), factory=lambda config: replace(robot.MY_PLUGIN, **change))
    assert_caught(spec, "its numbers are those of an arm", complaint)


@pytest.mark.slow
def test_a_robot_whose_hand_is_turned_by_a_quarter():
    quarter = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    spec = replace(
        spec_of(robot), factory=lambda config: replace(robot.MY_PLUGIN, rotation_hand_to_site=quarter)
    )
    assert_caught(spec, "its fingers close along right", "m along up")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"name": "reach"}, "own name is 'reach'"),
        ({"seconds": 0.0}, "takes 0.0 s"),
        ({"sustain": 9.0}, "9.0 s"),
    ],
)
def test_what_a_task_says(change, complaint):
    class Said:
        name, seconds, sustain = "my-plugin", 6.0, 0.2

    said = type("Said", (Said,), change)
    assert_caught(
        replace(spec_of(task), factory=lambda config: said()), "it says how long it takes", complaint
    )


@pytest.mark.slow
def test_a_task_that_wins_itself_whose_expert_dawdles_and_rolls_its_own_dice():
    class Dawdling(task.MyPlugin):
        def make(self, robot, setting):
            world = super().make(robot, setting)
            world.succeeded = lambda: world.sim.data.time > 0.3
            return world

    class Unsure(task.MyPlugin):
        def expert(self, world, start, rng):
            return super().expert(world, start, np.random.default_rng())

    class Lazy(task.MyPlugin):
        def expert(self, world, start, rng):
            yield start

    spec = spec_of(task)
    for factory, sentence, complaint in (
        (Dawdling, "a hand that waits does not win", "while the hand stays where it began"),
        (Unsure, "its expert's commands are pose vectors", "the second time"),
        (Lazy, "its expert succeeds in time", "not done, not done"),
    ):
        assert_caught(replace(spec, factory=factory), sentence, complaint)


@pytest.mark.slow
def test_a_look_that_physics_feels_and_one_that_forgets_its_seed():
    class Slippery(look.MyPlugin):
        def dress(self, model, data, rng):
            model.geom_friction[:] *= 0.1
            model.opt.gravity[2] = -5.0

    class Forgetful(look.MyPlugin):
        def dress(self, model, data, rng):
            super().dress(model, data, np.random.default_rng())

    spec = spec_of(look)
    for factory, sentence, complaint in (
        (Slippery, "physics feels nothing of it", "move otherwise"),
        (Forgetful, "a seed decides the pictures, and nothing else does", "looks different"),
    ):
        assert_caught(replace(spec, factory=factory), sentence, complaint)


# Primitives -----------------------------------------------------------------------------------------


def test_a_primitive_whose_parameters_are_no_numbers():
    """Its other faults are in tests/test_testing.py."""

    class Named:
        def __init__(self, config):
            pass

        def sample(self, rng):
            corners = rng.uniform(0.01, 0.1) * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
            return replace(convex_mesh(corners), parameters={"colour": "red"})

    assert_caught(
        replace(spec_of(primitive), factory=Named), "its arrays are a mesh", "parameter 'colour' is 'red'"
    )
    assert finding(spec_of(primitive), "its arrays are a mesh").status == OK

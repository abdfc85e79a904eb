"""Actuators of a user's file: what an action reaches, torques, and joints that turn the other way."""

from __future__ import annotations

import re

import numpy as np
import pytest

from romgrl.errors import ConfigurationError
from romgrl.humanoid.loads import replay
from romgrl.humanoid.model import fingerprint
from romgrl.humanoid.task import controls
from tests.humanoid.files import TOE, Builder


def test_torque_needs_a_largest_torque(changed: Builder) -> None:
    bare = TOE.replace('forcelimited="true" forcerange="-40 40"', 'forcelimited="false"')
    changed((TOE, bare))
    reason = "joint L_Toe's actuator has no largest torque; needed for humanoid.actuation=torque: a forcerange"
    with pytest.raises(ConfigurationError, match=f"^humanoid.xml: {reason} that ends above 0$"):
        changed((TOE, bare), actuation="torque")


@pytest.mark.parametrize(
    ("ranged", "expected"),
    [
        ('ctrlrange="-0.3 0.3"', (-0.3, 0.3)),
        ('ctrlrange="-2 9" ctrllimited="true"', (-2.0, 9.0)),
        ("", (-1.0, 1.0)),
        ('ctrlrange="-2 9" ctrllimited="false"', (-1.0, 1.0)),
    ],
)
def test_an_action_reaches_from_end_to_end_of_the_controls(
    changed: Builder, ranged: str, expected: tuple[float, float]
) -> None:
    """Of a servo those of the file, where it names any; of a torque -1 and 1."""
    place = TOE.partition(" forcelimited")[0]
    written = place, f'name="L_Toe" joint="L_Toe" {ranged}'
    model = changed(written)
    index = model.actuator("L_Toe").id
    assert model.actuator_ctrllimited.all()
    assert [controls(model, np.full(21, action))[index] for action in (-1.0, 1.0)] == pytest.approx(expected)
    assert changed(written, actuation="torque").actuator_ctrlrange.tolist() == [[-1.0, 1.0]] * 21


def test_a_joint_that_turns_the_other_way_is_the_same_joint(changed: Builder, text: str) -> None:
    """With its range, spring, controls and torques of the other sign, it acts as the one of the skeleton."""
    joint = re.search('<joint name="L_Knee".*/>', text)
    servo = re.search('<general name="L_Knee".*/>', text)
    assert joint
    assert servo
    turned = joint[0].replace('axis="1 0 0"', 'axis="-1 0 0"').replace("0 2.5", "-2.5 0")
    turned = turned.replace("-17.8586", "17.8586").replace('springref="', 'springref="-')
    driven = servo[0].replace("-0.5 1.7", "-1.7 0.5").replace("-424.155 145.874", "-145.874 424.155")
    model, plain = changed((joint[0], turned), (servo[0], driven)), changed()
    assert fingerprint(model) == fingerprint(plain)
    action = np.random.default_rng(0).uniform(-1, 1, 21)
    state = np.zeros((1, 48))
    state[0, 1], state[0, 3:24], state[0, 24:] = 2.0, 0.2, 0.5
    first, second = (replay(each, state, action[None], substeps=4).arrays() for each in (model, plain))
    for name, values in first.items():
        assert values == pytest.approx(second[name]), name


def test_names_that_another_actuator_had(changed: Builder) -> None:
    model = changed(
        ('name="L_Knee" joint="L_Knee"', 'name="L_Ankle" joint="L_Knee"'),
        ('name="L_Ankle" joint="L_Ankle"', 'name="L_Knee" joint="L_Ankle"'),
    )
    assert model.actuator("L_Knee").forcerange.tolist() == [-424.155, 145.874]

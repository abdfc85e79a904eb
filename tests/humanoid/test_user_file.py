"""A user's file with more than the skeleton's bodies, and files that do not fit: one line that says what is needed."""

from __future__ import annotations

import re
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import mujoco.viewer
import numpy as np
import pytest

from romgrl.cli.consistency import humanoid_file
from romgrl.config.schema import Config
from romgrl.errors import ConfigurationError
from romgrl.humanoid.loads import replay
from romgrl.humanoid.model import build, dimensions
from romgrl.humanoid.observation import observe
from romgrl.humanoid.plausible import check_motion, check_numbers
from romgrl.humanoid.skeleton import SMPL, without_file
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.report import film
from romgrl.stages import watch
from tests.humanoid.files import TOE, Builder

PELVIS, THIGH, SHIN = (f'<body name="{name}"' for name in ("Pelvis", "L_Hip", "L_Knee"))
MOUNT = '<body name="mount" pos="0.1 0 0.2" euler="0.1 0.2 0.3"><geom size="0.02" mass="2"/><body/></body>'
SHOE = '<body name="shoe"><geom type="box" pos="0 -0.3 0" size="0.1 0.01 0.1" mass="1"/></body>'
KNEE, OPTION = 'range="0 2.5" springref="0.415628" armature="0.02" damping="3.17"', "<option"
SPRING = 'stiffness="15.3033 -17.8586 7.41721" range="0 2.5"'
MOTOR = 'gainprm="0.000265556 0.0744053'
GEOM = '<geom name="L_Knee_knee"'


@pytest.mark.parametrize("compact", [False, True])
@pytest.mark.parametrize("place", [THIGH, SHIN, '<body name="R_Wrist"'])
def test_a_further_body_is_carried_and_not_observed(changed: Builder, place: str, *, compact: bool) -> None:
    model, plain = changed((place, MOUNT + place)), changed()
    assert dimensions(model).mass == pytest.approx(dimensions(plain).mass + 2.0)
    env, bare = (PlanarHumanoidVectorEnv(model=of, num_envs=8, compact=compact) for of in (model, plain))
    assert env.observation_names == bare.observation_names
    assert env.compact_columns.tolist() == bare.compact_columns.tolist()
    env.reset(seed=0)
    generator = np.random.default_rng(1)
    for _ in range(5):
        seen, *_ = env.step(generator.uniform(-1, 1, (8, 21)).astype(np.float32))
    data = mujoco.MjData(model)
    for row, state in enumerate(env.states()):
        data.qpos[:], data.qvel[:] = np.split(state, 2)
        mujoco.mj_forward(model, data)
        assert seen[row] == pytest.approx(observe(model, data)[env.columns], rel=2e-7, abs=1e-12)
    assert np.array_equal(env.set_states(env.states()), bare.set_states(env.states()))


def test_a_further_body_below_a_foot_is_of_the_foot(changed: Builder) -> None:
    toe = '<body name="L_Toe"'
    model = changed((toe, SHOE.replace("<geom", '<geom contype="1" conaffinity="1"') + toe), ('contype="0"', ""))
    state = np.zeros((1, 48))
    state[0, 1] = dimensions(model).pelvis_height - 0.002
    assert replay(model, state, np.zeros((1, 21)), substeps=1).contact.tolist() == [[True, False]]


def test_static_bodies_stay_apart(changed: Builder) -> None:
    """A compiler that fuses would take the hands away."""
    model = changed(('<compiler angle="radian"', '<compiler angle="radian" fusestatic="true"'))
    assert model.nbody == 25


def test_pictures_follow_the_root_wherever_it_stands_in_the_file(
    changed: Builder, monkeypatch: pytest.MonkeyPatch
) -> None:
    bodies = "".join(f'<body name="{name}" pos="0.1 0 0">' for name in SMPL.bodies)
    geom = '<joint axis="1 0 0" type="slide"/><geom size="0.1"/>'
    tree = bodies.replace(">", f">{geom}", 1) + "</body>" * len(SMPL.bodies)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body name="marker" pos="5 0 0"/>{tree}</worldbody></mujoco>'
    )
    wrist = '<body name="R_Wrist"'
    lines, faint = film.side_view(changed((wrist, MOUNT + wrist)), np.zeros(24), SMPL.right_side)
    assert (len(lines), faint.sum()) == (25, 11)
    window = SimpleNamespace(cam=SimpleNamespace())
    monkeypatch.setattr(mujoco.viewer, "launch_passive", lambda *_, **__: nullcontext(window))
    monkeypatch.setattr(watch, "walk_on", lambda *_: iter(()))
    watch.play(SimpleNamespace(model=model), Path(), 0)
    assert window.cam.trackbodyid == model.body("Pelvis").id == 2
    lines, _ = film.side_view(model, np.array([3.0]), ())
    assert lines[0, 0].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("places", "reason"),
    [
        (
            [
                (SHIN, f'<body name="mount"><geom size="0.1"/>{SHIN}'),
                ('<body name="R_Hip"', '</body><body name="R_Hip"'),
            ],
            "body L_Knee hangs from mount; needed for the skeleton smpl: from L_Hip",
        ),
        (
            [(PELVIS, MOUNT.replace("mount", "ball") + PELVIS)],
            "body ball hangs from world; needed for the skeleton smpl: from a body of the humanoid",
        ),
        (
            [(PELVIS, f'<body name="cart">{PELVIS}'), ("</worldbody>", "</body></worldbody>")],
            "body Pelvis hangs from cart; needed for the skeleton smpl: from world",
        ),
        (
            [("<actuator>", '<actuator><motor name="extra" joint="R_Knee"/>')],
            "joint R_Knee has more than one actuator; needed: one",
        ),
    ],
)
def test_a_file_that_does_not_fit_is_one_line(
    changed: Builder, places: list[tuple[str, str]], reason: str, tmp_path: Path, smoke_config: Config
) -> None:
    with pytest.raises(ConfigurationError, match=f"^humanoid.xml: {re.escape(reason)}$"):
        changed(*places)
    smoke_config.humanoid.xml = str(tmp_path / "file.xml")
    (line,) = humanoid_file(smoke_config)
    assert line.startswith("humanoid.xml: ")
    assert line.endswith(f"a MuJoCo file with the bodies of smpl ({reason})")


@pytest.mark.parametrize(
    ("place", "instead", "reason"),
    [
        (KNEE, KNEE.replace("3.17", "nan"), "dof_damping of joint L_Knee is nan"),
        (KNEE, KNEE.replace("3.17", "-500"), "dof_damping of joint L_Knee is -500"),
        (KNEE, KNEE.replace("0.02", "-5"), "dof_armature of joint L_Knee is -5"),
        (KNEE, KNEE.replace("0.02", "nan"), "dof_armature of joint L_Knee is nan"),
        (KNEE, KNEE.replace("2.5", "nan"), "jnt_range of joint L_Knee is nan"),
        (SPRING, SPRING.replace("15.3033", "-1e9"), "joint root_x diverges from rest"),
        (KNEE, f'{KNEE} ref="nan"', "qpos0 of joint L_Knee is nan"),
        (OPTION, f'{OPTION} gravity="0 0 nan"', "the option gravity is nan"),
        (OPTION, f'{OPTION} gravity="0 0 1e300"', "the option gravity is 1e+300"),
        (OPTION, f'{OPTION} gravity="0 0 -1e9"', "joint root_z diverges from rest"),
        (SPRING, SPRING.replace("-17.8586", "nan"), "jnt_stiffnesspoly of joint L_Knee is nan"),
        (MOTOR, MOTOR.replace("0.0744053", "nan"), "actuator_gainprm of actuator L_Knee is nan"),
        (TOE, TOE.replace("-40 40", "-40 nan"), "actuator_forcerange of actuator L_Toe is nan"),
        (TOE, f'{TOE} gear="nan"', "actuator_gear of actuator L_Toe is nan"),
        (GEOM, f'{GEOM} friction="nan 1 1"', "geom_friction of geom L_Knee_knee of body L_Knee is nan"),
        (f'{SHIN} pos="0', f'{SHIN} pos="inf', "body_pos of body L_Knee is inf"),
        (SHIN, f'{SHIN} quat="nan 0 0 0"', "body_quat of body L_Knee is nan"),
        ("-0.4222 0", "-1000 0", "body_pos of body L_Knee is 1000 m long"),
        ("-0.4222 0", "-8 0", "body Pelvis stands 8.5"),
        ('mass="3.1609"', 'mass="1e300"', "body_mass of body L_Knee is 1e+300"),
        ('mass="3.1609"', 'mass="3160.9"', "the bodies have a mass of 3230.74 kg"),
    ],
)
def test_a_number_that_cannot_be_is_named(changed: Builder, place: str, instead: str, reason: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"^humanoid\.xml: {re.escape(reason)}.*needed: ") as refused:
        changed((place, instead))
    assert len(str(refused.value).splitlines()) == 1


def test_a_body_that_nothing_holds_up_is_refused(text: str, tmp_path: Path) -> None:
    bare = re.sub("<contact>.*</contact>", "", text, flags=re.DOTALL)
    (tmp_path / "file.xml").write_text(bare, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"^humanoid\.xml: no geom can touch the floor; needed: "):
        build(xml=tmp_path / "file.xml")


def test_the_check_of_a_body_leaves_it_as_it_is(changed: Builder) -> None:
    model = changed()
    before = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    after = np.zeros_like(before)
    mujoco.mj_saveModel(model, None, before)
    check_numbers(model)
    check_motion(model, dimensions(model).pelvis_height)
    mujoco.mj_saveModel(model, None, after)
    assert np.array_equal(before, after)


@pytest.mark.parametrize(
    ("place", "instead", "reason"),
    [
        (SHIN, f"{SHIN} size='1'", r"unrecognized attribute: 'size' Element 'body', line \d+$"),
        (KNEE, KNEE.replace('"0 2.5"', '"3 2.5"'), r"range\[1\] in joint Element name 'L_Knee', id 4, line \d+$"),
    ],
)
def test_what_mujoco_refuses_is_one_line_with_its_reason(
    changed: Builder, place: str, instead: str, reason: str
) -> None:
    with pytest.raises(ConfigurationError, match=rf"^humanoid\.xml: .*{reason}"):
        changed((place, instead))


@pytest.mark.parametrize("name", ["a" * 300, "~nobody-of-this-name/file.xml"])
def test_a_name_that_no_file_can_have_is_one_line(name: str, smoke_config: Config) -> None:
    with pytest.raises(ConfigurationError, match=r"^humanoid\.xml: no such file: .+$"):
        build(xml=name)
    smoke_config.humanoid.xml = name
    (line,) = humanoid_file(smoke_config)
    assert line.startswith("humanoid.xml: ")


def test_the_head_hangs_where_the_skeleton_has_it(text: str, tmp_path: Path) -> None:
    head = re.search(r'<body name="Head".*?</body>\s*', text, re.DOTALL)
    assert head
    other = text.replace(head[0], "").replace(THIGH, head[0] + THIGH)
    (tmp_path / "file.xml").write_text(other, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"^humanoid\.xml: body Head hangs from Pelvis; .*: from Neck$"):
        build(xml=tmp_path / "file.xml")


def test_bodies_without_joints_have_their_order_too(text: str, tmp_path: Path) -> None:
    """Joints and actuators alone would not tell."""
    other = replace(
        SMPL,
        parents={name: parent for name, parent in SMPL.parents.items() if name != "L_Hand"} | {"L_Hand": "L_Wrist"},
    )
    (tmp_path / "file.xml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match="bodies, joints and actuators must be in the order of the skeleton"):
        build(xml=tmp_path / "file.xml", skeleton=other)


def test_skeletons_that_cannot_be() -> None:
    many = {f"tail_{link}": f"tail_{link - 1}" if link else "Head" for link in range(41)}
    for parents, reason in (
        (dict(SMPL.parents) | many, "65 bodies, 64 at most"),
        (dict(SMPL.parents) | {"L_Knee": "Shin"}, "L_Knee's parent Shin must come before it"),
    ):
        with pytest.raises(ValueError, match=f"^skeleton smpl: {reason}"):
            replace(SMPL, parents=parents)


def test_another_skeleton_needs_a_file(smoke_config: Config) -> None:
    other = replace(SMPL, name="walker")
    smoke_config.humanoid.skeleton = "walker"
    with pytest.raises(ConfigurationError) as refused:
        build(skeleton=other)
    assert [str(refused.value)] == [*humanoid_file(smoke_config)] == [without_file("walker")]
    assert str(refused.value) == "humanoid.skeleton: walker is not allowed; allowed: smpl without humanoid.xml"

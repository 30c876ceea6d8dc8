import mujoco
import numpy as np
import pytest
import torch

from plat.envs import MotionTrackingEnv, make_keyframe_env
from plat.envs.physics import BatchedPhysics, Kinematics
from plat.envs.transforms import DomainRandomization


class PlainPhysics:
    """One simulation after the other, in plain MuJoCo: what a backend of somebody else's has to offer."""

    def __init__(self, model, num_sims, num_threads, device):
        self.num_sims = num_sims
        # parameters are set in each robot's own model
        self.models = [model.__copy__() for _ in range(num_sims)]
        self.nominal = model
        self.data = [mujoco.MjData(own) for own in self.models]
        for pair in zip(self.models, self.data, strict=True):
            mujoco.mj_forward(*pair)

    def _pairs(self, ids):
        rows = range(self.num_sims) if ids is None else ids.tolist()
        return [(self.models[row], self.data[row]) for row in rows]

    def _read(self, ids, get):
        return torch.from_numpy(np.array([get(model, data) for model, data in self._pairs(ids)], np.float32))

    def step(self, ctrl, nstep):
        for (model, data), target in zip(self._pairs(None), ctrl.numpy(), strict=True):
            data.ctrl[:] = target
            for _ in range(nstep):
                mujoco.mj_step2(model, data)
                mujoco.mj_step1(model, data)

    def diverged(self):
        return torch.zeros(self.num_sims, dtype=torch.bool)

    def set_state(self, ids, qpos, qvel):
        for (model, data), pos, vel in zip(self._pairs(ids), qpos.numpy(), qvel.numpy(), strict=True):
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = pos, vel
            mujoco.mj_step1(model, data)

    def state(self, ids=None):
        return self._read(ids, lambda model, data: data.qpos), self._read(ids, lambda model, data: data.qvel)

    def kinematics(self, bodies, ids=None):
        def velocity(model, data, body):
            out = np.empty(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, model.body(body).id, out, 0)
            return out

        vel = self._read(ids, lambda model, data: [velocity(model, data, body) for body in bodies])
        return Kinematics(
            self._read(ids, lambda model, data: [data.body(body).xpos for body in bodies]),
            self._read(ids, lambda model, data: [data.body(body).xquat for body in bodies]),
            vel[..., 3:],
            vel[..., :3],
            self._read(ids, lambda model, data: data.actuator_force),
        )

    def sensors(self, ids=None):
        names = [self.nominal.sensor(i).name for i in range(self.nominal.nsensor)]
        return {name: self._read(ids, lambda model, data, name=name: data.sensor(name).data) for name in names}

    def set_friction(self, ids, bodies, friction):
        for (model, _), value in zip(self._pairs(ids), friction.tolist(), strict=True):
            for body in bodies:
                model.geom_friction[(model.geom_bodyid == model.body(body).id) & (model.geom_contype > 0), 0] = value

    def set_com(self, ids, body, shift):
        for (model, _), offset in zip(self._pairs(ids), shift.numpy(), strict=True):
            model.body(body).ipos[:] = self.nominal.body(body).ipos + offset

    def set_mass(self, ids, body, change):
        for (model, _), more in zip(self._pairs(ids), change.numpy(), strict=True):
            nominal = self.nominal.body(body)
            model.body(body).mass[0] = nominal.mass[0] + more
            model.body(body).inertia[:] = nominal.inertia * (1 + more / nominal.mass[0])

    def set_gains(self, ids, stiffness, damping):
        for (model, _), kp, kd in zip(self._pairs(ids), stiffness.numpy(), damping.numpy(), strict=True):
            model.actuator_gainprm[:, 0] = self.nominal.actuator_gainprm[:, 0] * kp
            model.actuator_biasprm[:, 1] = -model.actuator_gainprm[:, 0]
            model.actuator_biasprm[:, 2] = self.nominal.actuator_biasprm[:, 2] * kd

    def push(self, ids, velocity):
        for (model, data), change in zip(self._pairs(ids), velocity.numpy(), strict=True):
            data.qvel[:6] += change
            mujoco.mj_step1(model, data)

    def state_dict(self):
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        states = np.empty((self.num_sims, mujoco.mj_stateSize(self.nominal, spec)))
        for row, pair in zip(states, self._pairs(None), strict=True):
            mujoco.mj_getState(*pair, row, spec)
        return {"states": torch.from_numpy(states)}

    def load_state_dict(self, state):
        for row, (model, data) in zip(state["states"].numpy(), self._pairs(None), strict=True):
            mujoco.mj_setState(model, data, row, mujoco.mjtState.mjSTATE_INTEGRATION)
            mujoco.mj_step1(model, data)


@pytest.mark.parametrize("physics", [BatchedPhysics, PlainPhysics])
def test_a_restored_physics_goes_on_the_same(library, physics):
    envs = [MotionTrackingEnv(library, 2, physics=physics) for _ in range(2)]
    tensordicts = [env.reset() for env in envs]
    action = 0.3 * torch.randn(2, 29)
    for _ in range(3):
        tensordicts[0] = envs[0].step(tensordicts[0].set("action", action))["next"].exclude("reward")
    envs[1].load_state_dict(envs[0].state_dict())
    ours, theirs = (env.step(tensordicts[0].copy().set("action", action))["next"] for env in envs)
    for key, value in ours.items(True, True):
        assert torch.equal(value, theirs[key]), key


@pytest.mark.parametrize("randomize", [False, True])
def test_another_physics_is_the_same_environment(library, randomize):
    rollouts = []
    for physics in ({}, {"physics": PlainPhysics}):
        torch.manual_seed(0)
        env = MotionTrackingEnv(library, 3, **physics)
        if randomize:
            randomization = DomainRandomization(env)
            randomization._reset_env_preprocess(None)
            randomization._steps_to_push[:] = 3
        state, steps = env.reset(), []
        for _ in range(10):
            if randomize:
                randomization._inv_call(None)
            state["action"] = 0.3 * torch.randn(3, 29)
            steps.append(env.step(state)["next"])
            state = steps[-1].exclude("reward")
        rollouts.append(torch.stack(steps))
    ours, theirs = rollouts
    for key in ours.keys(True, True):
        torch.testing.assert_close(ours[key], theirs[key], atol=2e-3, rtol=2e-3)


def test_a_task_runs_on_it(library):
    env = make_keyframe_env(library, 2, physics=PlainPhysics)
    assert env.rollout(5)["next", "reward"].shape == (2, 5, 1)
    assert isinstance(env.base_env.physics, PlainPhysics)
    assert torch.equal(env.base_env.qpos, env.base_env.physics.state()[0])

/* Policy of a bundle: its observation, term by term, and its network in ONNX Runtime. */
import { mask } from "./keyframes.mjs";
import { into, matrix } from "./rotations.mjs";

const SOON = 0.2;

export class Policy {
  static async open(ort, folder, name, robot, fetched) {
    const bundle = JSON.parse(new TextDecoder().decode(await fetched(`${folder}/bundle.json`)));
    if (bundle.format !== "plat-bundle" || bundle.version !== 1) throw new Error(`${name}: not a bundle of version 1, which this page reads`);
    if (bundle.robot.joint_names.join() !== robot.site.joints.join()) throw new Error(`${name}: drives other joints`);
    const session = await ort.InferenceSession.create(await fetched(`${folder}/policy.onnx`), { executionProviders: ["wasm"] });
    return Object.assign(new Policy(), {
      ort, name, bundle, robot, session, size: Math.max(...bundle.observation.terms.map((term) => term.stop)),
      maxSteps: bundle.command.max_steps, window: bundle.command.window ?? 3,
      seesParts: bundle.observation.terms.some((term) => term.name.startsWith("parts.")),
    });
  }

  observation(state, keyframe, stepsLeft, lastAction) {
    const { robot, bundle } = this, { site } = robot, joints = site.joints.length;
    const root = state.qpos.slice(0, 3), toWorld = matrix(state.qpos.slice(3, 7)), turn = matrix(keyframe.qpos.slice(3, 7));
    const parts = mask(keyframe, site), flags = parts ?? Array(joints + site.keypoints.length + 3).fill(1);
    const [horizontal, height, orientation] = flags.slice(-3);
    const points = robot.points(keyframe.qpos).map(({ pos }) => into(toWorld, pos.map((value, axis) => value - root[axis])));
    const away = keyframe.qpos.slice(0, 3).map((value, axis) => (value - root[axis]) * [horizontal, horizontal, height][axis]);
    const turned = [0, 1].flatMap((column) => [0, 1, 2].map((row) => [0, 1, 2].reduce((sum, k) => sum + toWorld[k][row] * turn[k][column], 0)));
    const terms = {
      "robot.joint_pos": state.qpos.slice(7).map((value, joint) => value - bundle.robot.default_joint_pos[joint]),
      "robot.joint_vel": state.joint_vel, "robot.root_ang_vel_b": state.root_ang_vel_b, "robot.root_lin_vel_b": state.root_lin_vel_b,
      "robot.gravity_b": toWorld[2].map((value) => -value), "robot.last_action": lastAction,
      "goal.joint_pos": keyframe.qpos.slice(7).map((value, joint) => value * flags[joint]),
      "goal.root_pos_b": into(toWorld, away), "goal.root_rot6d_b": turned.map((value) => value * orientation),
      "goal.keypoint_pos_b": points.flatMap((point, body) => point.map((value) => value * flags[joints + body])),
      "command.horizon": [stepsLeft / this.maxSteps],
      "parts.joints": flags.slice(0, joints), "parts.bodies": flags.slice(joints, -3), "parts.root": flags.slice(-3),
      "clock.soon": [Math.min((stepsLeft * bundle.control_dt) / SOON, 1)], "clock.in_window": [stepsLeft <= this.window ? 1 : 0],
    };
    const values = new Float32Array(this.size);
    for (const { name, start } of bundle.observation.terms) {
      if (!(name in terms)) throw new Error(`${this.name} observes ${name}, which this page does not know`);
      values.set(terms[name], start);
    }
    return values;
  }

  async targets(observation) {
    const input = new this.ort.Tensor("float32", observation, [1, this.size]);
    const output = await this.session.run({ [this.bundle.observation.name]: input });
    return Array.from(output[this.bundle.action.name].data);
  }

  action(targets) {
    const { default_joint_pos, action_scale } = this.bundle.robot;
    return targets.map((value, joint) => (value - default_joint_pos[joint]) / action_scale[joint]);
  }
}

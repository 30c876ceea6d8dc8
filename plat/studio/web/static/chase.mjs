/* Chase: one robot and one policy that goes after keyframes, and what became of each of them.
   The same rules as plat.control.Chase and plat.control.KeyframeScorer, by which they are tested. */
import { asArrived, between, following, general, mask, nearestStep, withCommandedRoot } from "./keyframes.mjs";
import { angle } from "./rotations.mjs";

/* A number that is beyond a limit, with as many digits as show it. */
export const beyond = (value, limit, digits = 2) => {
  while (Number(value.toFixed(digits)) <= limit && limit < value) digits += 1;
  return value.toFixed(digits);
};
const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;
const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

export class Chase {
  constructor(robot, policy, start, frames) {
    const partial = frames.find((frame) => mask(frame, robot.site));
    if (partial && !policy.seesParts)
      throw new Error(`the keyframe at ${general(partial.time)} s${partial.name ? ` ('${partial.name}')` : ""} commands a part of its pose, but ${policy.name} was trained on whole poses: command all of it, or choose another policy`);
    Object.assign(this, { robot, policy, frames, start, control_dt: robot.site.control_dt });
    this.data = robot.begin(start.qpos);
    this.arrivals = [0, ...frames.map((frame) => nearestStep(frame.time, robot.site))];
    this.lastAction = Array(robot.site.joints.length).fill(0);
    this.poses = [[...start.qpos]];
    this.errors = [];
    this.taken = 0;
    this.finished = false;
    this.ended = ""; // when and why the simulation ended early
    this.scorer = new Scorer(robot, frames);
    // keyframes are where their arrivals are, on control steps, however their times are written
    const onSteps = (poses) => poses.map((pose, index) => ({ ...pose, time: this.arrivals[index] * this.control_dt }));
    this.arrived = onSteps(following(asArrived, start, frames, robot.site));
    this.commanded = onSteps(following(withCommandedRoot, start, frames, robot.site));
  }

  get time() { return this.taken * this.control_dt; }
  poseAt(time) { return this.poses[Math.min(Math.max(nearestStep(time, this.robot.site), 0), this.poses.length - 1)]; }
  commandAt(time) { return this.frames[this.command(Math.max(nearestStep(time, this.robot.site) - 1, 0)).index]; }

  command(step) {
    let index = 0;
    while (index < this.frames.length && this.arrivals[index + 1] <= step) index += 1;
    if (index === this.frames.length) return { index: index - 1, left: 1, holding: true };
    return { index, left: this.arrivals[index + 1] - step, holding: false };
  }

  async step() {
    const command = this.command(this.taken), end = this.arrivals[this.frames.length] * this.control_dt + this.robot.site.hold;
    if (command.holding && this.time + 1e-9 >= end) {
      this.finished = true;
      this.data.delete();
      this.data = null;
      return;
    }
    const { robot, policy } = this, keyframe = this.frames[command.index];
    if (this.began?.index !== command.index) {
      // what the keyframe before left open of the root is as the robot has it
      const line = this.commanded[command.index], commands = command.index ? this.frames[command.index - 1].commands : null;
      this.began = { index: command.index, pose: withCommandedRoot({ qpos: [...this.data.qpos] }, { ...line, commands }, robot.site) };
    }
    const observed = policy.observation(robot.state(this.data), keyframe, command.left, this.lastAction);
    const targets = await policy.targets(observed);
    if (this.data === null) return; // it was ended meanwhile
    const wrong = targets.findIndex((target) => !Number.isFinite(target));
    if (wrong >= 0) return this.lose(`the target of joint '${robot.site.joints[wrong]}' is ${targets[wrong]}, expected a finite angle`);
    this.lastAction = policy.action(targets);
    if (!robot.step(this.data, targets)) return this.lose(`the simulation diverged ${this.time.toFixed(2)} s after its start: targets or pushes are too large`);
    this.taken += 1;
    const qpos = [...this.data.qpos];
    this.poses.push(qpos);
    const way = between([this.began.pose, this.commanded[command.index + 1]], this.time);
    const ends = command.holding ? [] : [this.commanded[command.index], this.commanded[command.index + 1]];
    this.scorer.add(command, qpos, this.time, between(this.arrived, this.time), way, policy.window, ends);
    this.errors.push(compare(robot, qpos, keyframe, mask(keyframe, robot.site))); // how far it still is
  }

  /* End early: the robot fell from here on. */
  lose(why) {
    this.ended = `at ${this.time.toFixed(2)} s: ${why}; it fell from there on`;
    this.scorer.lose(this.time);
    this.end();
  }

  end() {
    if (this.data) this.data.delete();
    this.data = null;
    this.finished = true;
  }
}

/* How far a robot is from a pose, in the parts that are commanded; the root is where it is commanded to be. A root that
   is as low or tilted as at one of the ends of the way has not fallen. */
export function compare(robot, qpos, pose, parts, place = pose, ends = []) {
  const limits = robot.site.limits, count = robot.site.joints.length;
  const actual = robot.points(qpos), wanted = robot.points(pose.qpos);
  wanted[0] = { pos: place.qpos.slice(0, 3), quat: place.qpos.slice(3, 7) };
  const flags = parts ?? Array(count + actual.length + 3).fill(1), [horizontal, upright, orientation] = flags.slice(-3);
  const distances = actual.map((point, body) => apart(point.pos, wanted[body].pos)), heights = actual.map((point, body) => Math.abs(point.pos[2] - wanted[body].pos[2]));
  const off = qpos.slice(7).map((value, joint) => Math.abs(value - pose.qpos[7 + joint])), joints = off.filter((_, joint) => flags[joint]);
  const counted = actual.map((_, body) => (flags[count + body] || (body === 0 && horizontal && upright) ? 1 : 0));
  const root = Math.hypot(...actual[0].pos.map((value, axis) => (value - wanted[0].pos[axis]) * [horizontal, horizontal, upright][axis]));
  const commanded = distances.filter((_, body) => flags[count + body]);
  const bodies = parts ? Math.max(0, ...commanded) : 0, rootTurn = angle(actual[0].quat, wanted[0].quat);
  const lean = (point) => point.quat[1] ** 2 + point.quat[2] ** 2;
  const tilt = 2 * (lean(actual[0]) - lean(wanted[0])), low = actual[0].pos[2], meant = wanted[0].pos[2];
  let sunk = heights[0] > limits.root_height, tilted = Math.abs(tilt) > limits.root_tilt;
  if (parts) {
    sunk = sunk && (upright || (low < limits.fallen_height && low < meant));
    tilted = tilted && (orientation || tilt > 0);
  }
  const anchorTurn = angle(actual[robot.anchor].quat, wanted[robot.anchor].quat), fallen = Boolean(sunk || tilted);
  const highest = (list) => Math.max(0, ...list.map((body) => heights[body]));
  const offPose = parts
    ? (upright && heights[0] > limits.anchor_height) || (orientation && rootTurn ** 2 > limits.anchor_rot_squared) || heights.some((value, body) => flags[count + body] && value > limits.end_effector_height) || fallen
    : heights[robot.anchor] > limits.anchor_height || anchorTurn ** 2 > limits.anchor_rot_squared || highest(robot.ends) > limits.end_effector_height;
  const joint = joints.length ? mean(joints) : 0, turn = parts ? rootTurn * orientation : anchorTurn;
  const near = root <= limits.root && joint <= limits.joints && (!parts || (bodies <= limits.bodies && turn <= limits.turn));
  const allowed = [place, ...ends], lowest = Math.min(...allowed.map((end) => end.qpos[2]));
  const leaning = Math.max(...allowed.map((end) => lean({ quat: end.qpos.slice(3, 7) })));
  const down = (low < limits.fallen_height && lowest >= limits.fallen_height + limits.sag) || 2 * (lean(actual[0]) - leaning) > limits.fallen_tilt;
  const total = counted.reduce((a, b) => a + b, 0);
  const keypoint = total ? distances.reduce((sum, value, body) => sum + value * counted[body], 0) / total : null;
  const watched = parts ? heights.map((_, body) => body).filter((body) => flags[count + body] || (body === 0 && upright)) : [robot.anchor, ...robot.ends];
  return { joint, keypoint, root, bodies, turn, near: near && !down, offPose: Boolean(offPose), fallen, down, height: highest(watched), joints: joints.length > 0 };
}

class Scorer {
  constructor(robot, frames) {
    Object.assign(this, { robot, frames, steps: frames.map(() => []), late: {}, fell: null, lost: false });
  }

  add(command, qpos, time, reference, place, window, ends) {
    const { robot } = this, { site } = robot, parts = mask(this.frames[command.index], site);
    const before = command.holding ? command.index : command.index - 1, missed = this.steps[before]?.at(-1);
    if (missed && !(before in this.late) && !missed.near) {
      const keyframe = this.frames[before], there = withCommandedRoot(missed.place, keyframe, site);
      if (compare(robot, qpos, keyframe, mask(keyframe, site), there).near) this.late[before] = Math.round(1e6 * (time - missed.time)) / 1e6;
    }
    const errors = compare(robot, qpos, reference, parts, place, ends);
    if (!command.holding) this.steps[command.index].push({ ...errors, time, place, inWindow: command.left <= window, arrival: command.left === 1 });
    else if (errors.down && this.fell === null) this.fell = time;
  }

  get done() { return this.steps.filter((steps) => steps.length && steps[steps.length - 1].arrival).length; }

  /* Count the robot as fallen from a time on (s): keyframes that have not arrived never will. */
  lose(time) {
    this.lost = true;
    if (this.done === this.frames.length) this.fell ??= time;
  }

  /* Scores of the keyframes that have arrived, and of those that never will. */
  scores() {
    const limits = this.robot.site.limits, { done } = this;
    const lost = (this.lost ? this.frames.slice(done) : []).map(({ number, name, time }) => ({ number, name, time, outcome: "fell", status: "fell", words: "fell", joint: null, keypoint: null }));
    return [...this.steps.slice(0, done).map((steps, index) => {
      const arrival = steps[steps.length - 1], window = steps.filter((step) => step.inWindow), parts = mask(this.frames[index], this.robot.site);
      const fell = steps.some((step) => step.down), reached = !fell && arrival.near && !window.some((step) => step.offPose);
      const late = fell ? undefined : this.late[index], height = Math.max(...window.map((step) => step.height)), turn = Math.max(...window.map((step) => step.turn));
      const edge = Math.min(limits.anchor_height, limits.end_effector_height);
      const farTurned = parts && arrival.turn > limits.turn ? limits.turn : Math.sqrt(limits.anchor_rot_squared);
      const faults = fell || reached ? [] : [
        late !== undefined && `${late.toFixed(2)} s late`, arrival.root > limits.root && `${beyond(arrival.root, limits.root)} m off`,
        arrival.joint > limits.joints && `joints ${beyond(arrival.joint, limits.joints)} rad off`, arrival.bodies > limits.bodies && `a commanded body ${beyond(arrival.bodies, limits.bodies)} m off`,
        height > edge && `a hand, a foot or the torso ${beyond(height, edge)} m too high or low`, turn > farTurned && `turned by ${beyond(turn, farTurned)} rad`,
      ].filter(Boolean);
      // what no part of the keyframe says is left: the root fell by TKS, of a partial one that does not command it
      if (!fell && !reached && !faults.length) faults.push("the root too low or tilted");
      const afterwards = index === this.frames.length - 1 && this.fell !== null && !arrival.down;
      const outcome = fell ? "fell" : reached ? "reached" : "late or off";
      return {
        number: this.frames[index].number, name: this.frames[index].name, time: this.frames[index].time, outcome,
        status: fell || afterwards ? "fell" : reached ? "reached" : "late",
        words: outcome + (faults.length ? `: ${faults.join(", ")}` : "") + (afterwards ? "; fell afterwards" : ""),
        joint: arrival.joints ? mean(window.map((step) => step.joint)) : null, keypoint: arrival.keypoint !== null ? mean(window.map((step) => step.keypoint)) : null,
      };
    }), ...lost];
  }
}
